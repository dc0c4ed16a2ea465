#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Accuracy on recorded logs in TUM format, with each rule for what moves and without rejection.

    evaluate.py DIR... [--seeds 5]

Every log is replayed in lockstep under the rules "silhouette" and "paper" and with rejection off, once for each of the
seeds 1 to N. The camera's profile goes by the log's name. Tables go to the screen; reports, trajectories, maps and a
drawing of the trajectories (of the seed with the median ATE) go to OUT/<log>/.
"""
import argparse
import statistics
import subprocess
import sys
from pathlib import Path

from stillmap_runs import ROOT, RunFailed, print_table, run_stillmap

RULES = ("silhouette", "paper", "off")
CAMERAS = {"fr1": "tum-fr1", "freiburg1": "tum-fr1", "fr3": "tum-fr3", "freiburg3": "tum-fr3", "office_walk": "hololens-540x360"}
# ATE RMSE in m from the papers' tables: ORB-SLAM3 and YOLOv5 + ORB-SLAM3 of the seed paper (Guan et al. 2023, Table 4).
PUBLISHED = {
    "fr3_walking_xyz": (0.162, 0.0144),
    "fr3_walking_halfsphere": (0.189, 0.0555),
    "fr3_sitting_xyz": (0.026, 0.0168),
    "fr3_sitting_halfsphere": (0.230, 0.1759),
}
HEAD = ("rule", "ATE m", "worst", "RPE m", "worst", "RPE deg", "worst", "frames/s", "tracked", "weak", "lost", "least coverage")


def fail(message):
    sys.exit(f"evaluate.py: {message}")


def short_name(log):
    """rgbd_dataset_freiburg3_walking_xyz and fr3_walking_xyz are one sequence."""
    return log.name.removeprefix("rgbd_dataset_").replace("freiburg", "fr")


def camera_of(log, given):
    if given:
        return given
    for name, camera in CAMERAS.items():
        if name in log.name:
            return ROOT / "firmware-config/cameras" / f"{camera}.toml"
    return fail(f"{log}: the name tells no camera that is known ({', '.join(CAMERAS)}); give its profile with --camera FILE")


def spread(reports, *names):
    """Median and worst (largest) over the seeds of a number of the reports."""
    values = []
    for report in reports:
        for name in names:
            report = report[name]
        values.append(report)
    return statistics.median(values), max(values)


def row(rule, reports):
    cells = [rule]
    for key, digits in (("ate_rmse_m", 4), ("rpe_1s_rmse_m", 4), ("rpe_1s_rmse_deg", 2)):
        cells += [f"{value:.{digits}f}" for value in spread(reports, "accuracy", key)]
    cells.append(f"{spread(reports, 'throughput_fps')[0]:.1f}")
    cells += [f"{spread(reports, 'tracking', key)[0]:g}" for key in ("tracked", "weak", "lost")]
    return (*cells, f"{min(report['accuracy']['coverage'] for report in reports):.3f}")


def evaluate(log, args):
    name, out = short_name(log), args.out / short_name(log)
    options = [word for option in ("detector_delay", "detector_every") if (value := getattr(args, option)) is not None
               for word in ("--" + option.replace("_", "-"), str(value))]
    model = ["--set", f"detector.model={args.model}"] if args.model else []
    rows, medians = [], []
    for rule in RULES:
        reports = []
        for seed in range(1, args.seeds + 1):
            reports.append(run_stillmap(args.bin / "stillmap", log, [camera_of(log, args.camera)], out / f"{rule}-{seed}", "--mode", "lockstep",
                                        "--set", f"track.dynamic_rule={rule}", "--set", f"runtime.seed={seed}", *model, *options))
            if "accuracy" not in reports[-1]:
                raise RunFailed(f"{log}: the run with rule {rule} and seed {seed} has too few poses for an accuracy, see {out / f'{rule}-{seed}'}")
        rows.append(row(rule, reports))
        median = min(reports, key=lambda r: abs(r["accuracy"]["ate_rmse_m"] - spread(reports, "accuracy", "ate_rmse_m")[0]))
        drawn = out / f"{rule}.txt"
        drawn.write_bytes((out / f"{rule}-{reports.index(median) + 1}" / "trajectory.txt").read_bytes())
        medians.append(drawn)
    detector = " ".join([Path(reports[0]["detector"]["model"]).name, *options])
    print(f"\n{name}: {reports[0]['frames']['offered']} frames, {args.seeds} seeds, detector {detector}")
    print_table(rows, HEAD)
    if name in PUBLISHED:
        orb_slam3, paper = PUBLISHED[name]
        print(f"published ATE RMSE: ORB-SLAM3 {orb_slam3} m, seed paper (YOLOv5 + ORB-SLAM3) {paper} m")
    subprocess.run([ROOT / "scripts/plot_trajectory.py", log / "groundtruth.txt", *medians, "--out", out / "trajectories.png"], check=True)
    print(f"trajectories: {out / 'trajectories.png'}", flush=True)


def positive(text):
    if (value := int(text)) < 1:
        raise ValueError
    return value


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", type=Path, metavar="DIR")
    parser.add_argument("--seeds", type=positive, default=5, metavar="N")
    parser.add_argument("--camera", type=Path, metavar="FILE", help="camera profile of all logs")
    parser.add_argument("--model", help="ONNX file, or none; default: the installed network")
    parser.add_argument("--detector-delay", metavar="N", help="frames that boxes come late")
    parser.add_argument("--detector-every", metavar="N", help="the detector looks at every n-th frame")
    parser.add_argument("--bin", type=Path, default=ROOT / "build/release/bin", help="folder of the program")
    parser.add_argument("--out", type=Path, default=ROOT / "evaluate-out")
    parser.add_argument("--only-parse", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    for log in args.logs:
        if not (log / "groundtruth.txt").is_file():
            fail(f"{log} holds no groundtruth.txt; name a folder in TUM format with ground truth")
        camera_of(log, args.camera)
    if args.only_parse:
        return
    try:
        for log in args.logs:
            evaluate(log.resolve(), args)
    except (RunFailed, subprocess.CalledProcessError) as error:
        fail(error)
    print("\nMedians and worst of the seeds; ATE and RPE are RMSE, RPE over 1 s. Frames/s in lockstep: one core, decoding included.")


if __name__ == "__main__":
    main()
