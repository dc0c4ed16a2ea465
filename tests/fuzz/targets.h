// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

namespace stillmap::fuzz {

using Bytes = std::span<const std::uint8_t>;

/// A way by which bytes of strangers come in. `run` takes any bytes, and ends the process where one of our
/// promises about them is broken; the sanitizers watch the rest.
struct Target {
  std::string_view name;  ///< of its folder in corpus/, too
  void (*run)(Bytes);
};
std::span<const Target> targets();
/// Null: there is none of that name.
const Target* find_target(std::string_view name);

void read_config(Bytes bytes);             ///< a configuration file; after a NUL, an override
void read_frame_list(Bytes bytes);         ///< associations.txt, or after a NUL depth.txt beside rgb.txt
void read_trajectory(Bytes bytes);         ///< a trajectory or ground truth in TUM format
void read_map(Bytes bytes);                ///< a .stillmap file; a wrong checksum is mended first
void read_manifest(Bytes bytes);           ///< what stands beside a model as its manifest
void read_keyframes(Bytes bytes);          ///< the keyframes of a .stillmap file, as a resumed run takes them
void decode_png(Bytes bytes);              ///< as colour and as depth
void decode_jpeg(Bytes bytes);             ///< from a file, and from a camera
void convert_camera_picture(Bytes bytes);  ///< 8 bytes of what a driver says of a picture, then the picture
void parse_message(Bytes bytes);           ///< what a WebSocket's client sends
void judge_request(Bytes bytes);           ///< lines: host, origin, token, cookies of a WebSocket's handshake
void serve_connection(Bytes bytes);        ///< what comes over a connection, beginning with its handshake

/// Ends the process where `holds` is false.
void require(bool holds);

}  // namespace stillmap::fuzz
