#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Accuracy on recorded logs in TUM format, with each rule for what moves and without rejection.

    evaluate.py DIR... [--seeds 5] [--rules silhouette,paper,off] [--modes lockstep] [--starts 0]

Every log is replayed under each rule in each mode, once from each of the starts (frames left out at the beginning) for each
of the seeds 1 to N. The camera's profile goes by the log's name. Tables go to the screen; reports, trajectories, maps and a
drawing of the trajectories (of the run with the median ATE) go to OUT/<log>/. What realtime gives says something only where
nothing else runs.
"""
import argparse
import itertools
import json
import statistics
import subprocess
import sys
from pathlib import Path

from stillmap_runs import ROOT, RunFailed, print_table, run_stillmap

RULES = ("silhouette", "paper", "off")
MODES = ("lockstep", "realtime")
CAMERAS = {"fr1": "tum-fr1", "freiburg1": "tum-fr1", "fr3": "tum-fr3", "freiburg3": "tum-fr3", "office_walk": "hololens-540x360"}
# ATE RMSE in m from the papers' tables: ORB-SLAM3 and YOLOv5 + ORB-SLAM3 of the seed paper (Guan et al. 2023, Table 4).
PUBLISHED = {
    "fr3_walking_xyz": (0.162, 0.0144),
    "fr3_walking_halfsphere": (0.189, 0.0555),
    "fr3_sitting_xyz": (0.026, 0.0168),
    "fr3_sitting_halfsphere": (0.230, 0.1759),
}
HEAD = ("rule, mode", "ATE m", "worst", "final m", "worst", "RPE m", "worst", "RPE deg", "worst", "tracked", "weak", "lost", "least coverage",
        "in ellipsoid", "frames/s", "tracking ms, p50", "p99")


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


def row(name, reports):
    cells = [name]
    for key, digits in (("ate_rmse_m", 4), ("final_ate_rmse_m", 4), ("rpe_1s_rmse_m", 4), ("rpe_1s_rmse_deg", 2)):
        cells += [f"{value:.{digits}f}" for value in spread(reports, "accuracy", key)]
    cells += [f"{spread(reports, 'tracking', key)[0]:g}" for key in ("tracked", "weak", "lost")]
    cells.append(f"{min(report['accuracy']['coverage'] for report in reports):.3f}")
    cells.append(f"{spread(reports, 'accuracy', 'share_in_90_percent_ellipsoid_1s')[0]:.2f}")
    cells.append(f"{spread(reports, 'throughput_fps')[0]:.1f}")
    return (*cells, *(f"{spread(reports, 'latency_ms', 'track_cpu', key)[0]:.1f}" for key in ("p50", "p99")))


def begun_at(log, start, out):
    """The log without its first frames: its folders and lists by link, but for the list of its pictures."""
    if start == 0:
        return log
    folder = out / f"from-{start}"
    folder.mkdir(parents=True, exist_ok=True)
    frames = "associations.txt" if (log / "associations.txt").is_file() else "rgb.txt"
    for entry in log.iterdir():
        link = folder / entry.name
        link.unlink(missing_ok=True)
        if entry.name != frames:
            link.symlink_to(entry)
    lines = [line for line in (log / frames).read_text().splitlines(keepends=True) if line.strip() and not line.startswith("#")]
    (folder / frames).write_text("".join(lines[start:]))
    return folder


def run(log, camera, out, binary, *options):
    """The report of one run, with the ATE of its final trajectory beside that of the causal one."""
    report = run_stillmap(binary, log, [camera], out, "--trajectory-final", out / "final.txt", *options)
    if "accuracy" not in report:
        raise RunFailed(f"{log}: the run has too few poses for an accuracy, see {out}")
    final = subprocess.run([binary, "eval", "--groundtruth", log / "groundtruth.txt", "--estimate", out / "final.txt"],
                           capture_output=True, text=True, check=True)
    report["accuracy"]["final_ate_rmse_m"] = json.loads(final.stdout)["ate_rmse_m"]
    return report


def evaluate(log, args):
    name, out, camera = short_name(log), args.out / short_name(log), camera_of(log, args.camera)
    model = ["--set", f"detector.model={args.model}"] if args.model else []
    late = [word for option in ("detector_delay", "detector_every") if (value := getattr(args, option)) is not None
            for word in ("--" + option.replace("_", "-"), str(value))]
    rows, drawn = [], []
    for rule, mode in itertools.product(args.rules, args.modes):
        reports = {}
        for start, seed in itertools.product(args.starts, range(1, args.seeds + 1)):
            folder = out / f"{rule}-{mode}-{start}-{seed}"
            reports[folder] = run(begun_at(log, start, out), camera, folder, args.bin / "stillmap", "--mode", mode,
                                  "--set", f"track.dynamic_rule={rule}", "--set", f"runtime.seed={seed}", *model, *late)
        rows.append(row(f"{rule}, {mode}", reports.values()))
        median = spread(reports.values(), "accuracy", "ate_rmse_m")[0]
        nearest = min((abs(report["accuracy"]["ate_rmse_m"] - median), folder) for folder, report in reports.items())[1]
        drawn.append(out / f"{rule}-{mode}.txt")
        drawn[-1].write_bytes((nearest / "trajectory.txt").read_bytes())
    starts = "" if args.starts == [0] else f", begun {', '.join(map(str, args.starts))} frames late"
    detector = " ".join([Path(reports[nearest]["detector"]["model"]).name, *late])
    print(f"\n{name}: {reports[nearest]['frames']['offered']} frames{starts}, {args.seeds} seeds, detector {detector}")
    print_table(rows, HEAD)
    if name in PUBLISHED:
        orb_slam3, paper = PUBLISHED[name]
        print(f"published ATE RMSE: ORB-SLAM3 {orb_slam3} m, seed paper (YOLOv5 + ORB-SLAM3) {paper} m")
    subprocess.run([ROOT / "scripts/plot_trajectory.py", log / "groundtruth.txt", *drawn, "--out", out / "trajectories.png"], check=True)
    print(f"trajectories: {out / 'trajectories.png'}", flush=True)


def positive(text):
    if (value := int(text)) < 1:
        raise ValueError
    return value


def list_of(*allowed):
    """What argparse makes of a comma-separated list of these words."""
    def parse(text):
        words = text.split(",")
        if any(word not in allowed for word in words):
            raise argparse.ArgumentTypeError(f"{text}: a list of {', '.join(allowed)} is expected")
        return words
    return parse


def frame_counts(text):
    if min(counts := [int(word) for word in text.split(",")]) < 0:
        raise ValueError
    return counts


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", type=Path, metavar="DIR")
    parser.add_argument("--seeds", type=positive, default=5, metavar="N")
    parser.add_argument("--rules", type=list_of(*RULES), default=list(RULES), metavar="RULE,...")
    parser.add_argument("--modes", type=list_of(*MODES), default=["lockstep"], metavar="MODE,...")
    parser.add_argument("--starts", type=frame_counts, default=[0], metavar="N,...", help="frames left out at the beginning, a run for each")
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
    if args.modes != ["lockstep"] and (args.detector_delay or args.detector_every):
        fail("--detector-delay and --detector-every go with lockstep alone; in realtime boxes are as late as they are")
    if args.only_parse:
        return
    try:
        for log in args.logs:
            evaluate(log.resolve(), args)
    except (RunFailed, subprocess.CalledProcessError) as error:
        fail(error)
    print("\nMedians and worst of the runs; ATE and RPE are RMSE, RPE over 1 s, final: with all corrections. In ellipsoid: share of the errors"
          "\nover 1 s in the 90 % ellipsoid of the poses' covariances. Frames/s in lockstep: one core, decoding included. Tracking: processor time.")


if __name__ == "__main__":
    main()
