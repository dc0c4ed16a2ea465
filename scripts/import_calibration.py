#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Makes a camera profile of a calibration.

    import_calibration.py FILE [--depth-units-per-m N] [--fps N] > my-camera.toml

FILE is a ROS camera_info YAML (camera_calibration's ost.yaml) or a Kalibr camchain YAML. In a camchain, cam0 is colour;
a cam1 is taken for a depth camera that does not register its pictures by itself.
"""
import argparse
import sys

import yaml


class Unusable(Exception):
    """What is wrong with the calibration, and the mend."""


def number_list(value, count, what):
    def is_number(v):
        return isinstance(v, (int, float)) and not isinstance(v, bool) and abs(v) < 1e9  # no camera has more; NaN neither
    if not isinstance(value, list) or len(value) < count or not all(map(is_number, value)):
        raise Unusable(f"{what} must be a list of {count} numbers; calibrate again")
    return [float(v) for v in value]


def table(text, key):
    if not isinstance(text[key], dict):
        raise Unusable(f"{key} is no table of keys and values; calibrate again")
    return text[key]


def lens(size, intrinsics, model, known_models, coefficients):
    if model not in known_models:
        raise Unusable(f"distortion model '{model}' is none of {', '.join(known_models)}; calibrate again with that model")
    k1, k2, p1, p2, k3 = [*coefficients, 0.0, 0.0, 0.0, 0.0, 0.0][:5]
    return {"width": int(size[0]), "height": int(size[1])} | dict(zip(("fx", "fy", "cx", "cy"), intrinsics)) | {
        "k1": k1, "k2": k2, "p1": p1, "p2": p2, "k3": k3}


def from_ros(text):
    matrix = number_list(table(text, "camera_matrix")["data"], 9, "camera_matrix")
    size = number_list([text["image_width"], text["image_height"]], 2, "image_width, image_height")
    return lens(size, (matrix[0], matrix[4], matrix[2], matrix[5]), text["distortion_model"], ("plumb_bob",),
                number_list(table(text, "distortion_coefficients")["data"], 4, "distortion_coefficients"))


def from_kalibr(camera):
    if camera.get("camera_model") != "pinhole":
        raise Unusable(f"camera model '{camera.get('camera_model')}' is not pinhole; calibrate again with pinhole-radtan")
    return lens(number_list(camera["resolution"], 2, "resolution"), number_list(camera["intrinsics"], 4, "intrinsics"),
                camera["distortion_model"], ("radtan", "none"), number_list(camera.get("distortion_coeffs") or [], 0, "distortion_coeffs"))


def inverse(transform):
    """Rotation (rows) and translation of the inverse of a 4x4 transform."""
    rotation = [[transform[c][r] for c in range(3)] for r in range(3)]
    return rotation, [-sum(rotation[r][c] * transform[c][3] for c in range(3)) for r in range(3)]


def quaternion(m):
    """x, y, z, w of a rotation matrix (Shepperd's method: by the largest of the four)."""
    squares = [1 + m[0][0] - m[1][1] - m[2][2], 1 - m[0][0] + m[1][1] - m[2][2], 1 - m[0][0] - m[1][1] + m[2][2], 1 + m[0][0] + m[1][1] + m[2][2]]
    products = [[0, m[0][1] + m[1][0], m[0][2] + m[2][0], m[2][1] - m[1][2]], [0, 0, m[1][2] + m[2][1], m[0][2] - m[2][0]], [0, 0, 0, m[1][0] - m[0][1]]]
    largest = squares.index(max(squares))
    half = 0.5 * max(squares) ** 0.5
    return [half if i == largest else products[min(i, largest)][max(i, largest)] / (4 * half) for i in range(4)]


def read(path):
    """Colour's lens and, where there is one, the depth camera's lens and its pose in colour."""
    try:
        with open(path, encoding="utf-8") as file:
            text = yaml.safe_load(file)
        if not isinstance(text, dict):
            raise Unusable("is no calibration")
        if "camera_matrix" in text:
            return from_ros(text), None, None
        if "cam0" not in text:
            raise Unusable("is neither a ROS camera_info (camera_matrix) nor a Kalibr camchain (cam0)")
        if "cam1" not in text:
            return from_kalibr(table(text, "cam0")), None, None
        rows = table(text, "cam1")["T_cn_cnm1"]
        if not isinstance(rows, list) or len(rows) < 3:
            raise Unusable("T_cn_cnm1 must be a list of 4 rows; calibrate again")
        rotation, translation = inverse([number_list(row, 4, "T_cn_cnm1") for row in rows])
        return from_kalibr(table(text, "cam0")), from_kalibr(table(text, "cam1")), translation + quaternion(rotation)
    except KeyError as missing:
        raise Unusable(f"has no {missing}; calibrate again") from None
    except RecursionError:
        raise Unusable("is nested too deeply for a calibration") from None
    except OSError as error:
        raise Unusable(f"{error.strerror}; give the YAML file of a calibration") from None
    except (ValueError, yaml.YAMLError) as error:
        raise Unusable(str(error).replace("\n", " ")) from None


def section(name, values):
    return "\n".join([f"[{name}]", *(f"{key} = {value!r}" for key, value in values.items())]) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file")
    parser.add_argument("--depth-units-per-m", type=float, help="raw depth of one metre; 1000 for millimetres")
    parser.add_argument("--fps", type=float, default=30.0)
    args = parser.parse_args()
    try:
        colour, depth, pose = read(args.file)
    except Unusable as error:
        sys.exit(f"import_calibration.py: {args.file}: {error}")
    units = 1000.0 if args.depth_units_per_m is None else args.depth_units_per_m
    print(f"# From {args.file}.")
    if args.depth_units_per_m is None:
        print("# A calibration does not say what depth is counted in: millimetres are assumed.")
    print(section("camera", colour | {"depth_units_per_m": units, "fps": args.fps}), end="")
    if depth:
        print("\n" + section("camera.depth", depth | {"T_colour_depth": pose}), end="")


if __name__ == "__main__":
    main()
