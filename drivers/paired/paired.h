// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "drivers/paired/registration.h"
#include "drivers/picture_stream.h"
#include "drivers/rgbd_driver.h"

namespace stillmap {

/// RGB-D frames from a stream of colour and one of depth: the pictures whose stamps lie within half a frame
/// of each other make a frame, which keeps both stamps. Colour is converted and depth copied (or registered)
/// straight from the device's buffer into the slot; what finds no partner is never touched.
///
/// Dropped, one by one, are colour pictures that the device lost (DriverDropped), that it marks as damaged or
/// that do not decode (CorruptColour), and those without depth: CorruptDepth or DriverDropped where the depth
/// device said so since the last frame, otherwise NoDepthMatch. One thread; `grab` takes nothing from the
/// heap.
class Paired : public RgbdDriver {
 public:
  struct Setup {
    std::string name;  ///< for SourceInfo
    CameraModel colour;
    double fps = 30;
    std::optional<CameraModel> depth_lens{};  ///< of a depth camera that does not register by itself
    Pose T_colour_depth{};                    ///< meaningful with depth_lens
  };
  Paired(Setup setup, std::unique_ptr<PictureStream> colour, std::unique_ptr<PictureStream> depth);

  /// The error says which of the two could not be opened, or why they do not fit the profile.
  Status open() override;
  SourceInfo describe() const override;
  Status start() override;
  GrabResult grab(FrameSlot& slot, Nanoseconds deadline_ns) override;
  void stop() override;

 private:
  GrabResult fill(FrameSlot& slot, const HeldPicture& colour, const HeldPicture& depth);

  Setup setup_;
  std::unique_ptr<PictureStream> colour_, depth_;
  std::optional<ColourConverter> converter_;       // made by open
  std::optional<DepthRegistration> registration_;  // made by open
  Nanoseconds half_frame_ns_ = 0;
  bool colour_is_new_ = true, depth_is_new_ = true;
  std::uint32_t missed_ = 0;                   // colour pictures that the device lost, not told yet
  std::optional<DropReason> depth_trouble_{};  // since the last frame
};

}  // namespace stillmap
