# SPDX-License-Identifier: Apache-2.0
# What the pictures and times of a run say; called by it:
#
#     blender -b -P report.py -- BALL.toml CASES MARRAM OUT
#
# Noise: the standard deviation between seeds, root mean square over the ball's pixels and channels, over the ball's mean. It
# falls with the square root of time, so noise^2 time is what a program needs for a given noise; "noise at equal time" is the
# root of the ratio of the two.
import json
import math
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from statistics import median

import bpy
import numpy as np


def load(path):
    picture = bpy.data.images.load(str(path))
    picture.colorspace_settings.name = "Raw"
    width, height = picture.size
    pixels = np.empty(width * height * 4, "f4")
    picture.pixels.foreach_get(pixels)
    bpy.data.images.remove(picture)
    return pixels.reshape(height, width, 4)[::-1].astype("f8")


def save(path, rgb, kind):
    height, width, _ = rgb.shape
    picture = bpy.data.images.new("out", width, height, float_buffer=kind == "OPEN_EXR")
    picture.colorspace_settings.name = "Raw"
    picture.use_half_precision = False
    pixels = np.ones((height, width, 4), "f4")
    pixels[..., :3] = rgb[::-1]
    picture.pixels.foreach_set(pixels.ravel())
    picture.filepath_raw, picture.file_format = str(path), kind
    picture.save()
    bpy.data.images.remove(picture)


def encoded(rgb):
    rgb = np.clip(rgb, 0, 1)
    return np.where(rgb <= 0.0031308, 12.92 * rgb, 1.055 * rgb ** (1 / 2.4) - 0.055)


def sky_behind(camera, sky, size):
    """The sky at pixel centres: its rows are alike all round, so that the ray's elevation says all."""
    eye, target = np.array(camera["position"], "f8"), np.array(camera["target"], "f8")
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, [0, 1, 0])
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    at = ((np.arange(size) + 0.5) / size * 2 - 1) * math.tan(math.radians(camera["fov"]) / 2)
    ray = ahead + at[None, :, None] * right - at[:, None, None] * up
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    row = (0.5 - np.arcsin(ray[..., 1]) / math.pi) * len(sky) - 0.5
    return np.stack([np.interp(row, np.arange(len(sky)), sky[:, c]) for c in range(3)], -1)


def marram_seconds(path):
    seconds = json.load(open(path))["seconds"]
    return sum(value for key, value in seconds.items() if key not in ("load", "total"))


def flip(marram, a, b, report=None):
    command = [marram, "compare", str(a), str(b)] + (["--report", str(report)] if report else [])
    said = subprocess.run(command, capture_output=True, text=True).stdout
    return float(re.search(r"FLIP\s+mean ([0-9.e+-]+)", said).group(1))


def parts(pictures, ball, level):
    """Marram's brightness over Cycles' in the squares of an eighth of the picture's side that are all ball and at least half as
    bright as it: least, greatest, and the deviation that noise alone gives one."""
    side = len(ball) // 8
    ratios, variances = [], []
    for y in range(0, 8 * side, side):
        for x in range(0, 8 * side, side):
            square = np.s_[y:y + side, x:x + side]
            one = {name: p[:, square[0], square[1], :3] for name, p in pictures.items()}
            mean = {name: p.mean() for name, p in one.items()}
            if not ball[square].all() or mean["cycles"] < 0.5 * level["cycles"].mean():
                continue
            ratios.append(mean["marram"] / mean["cycles"])
            # Channels share a path: their mean has the noise of a pixel.
            variances.append(sum(p.mean(-1).var(0, ddof=1).mean() / (p.shape[0] * side * side) / mean[name] ** 2
                                 for name, p in one.items()))
    return min(ratios), max(ratios), math.sqrt(np.mean(variances))


def measure(case, rounds, sky, camera, marram, out):
    pictures, seconds, processes = {}, {}, {"cycles": [], "marram": []}
    for name in processes:
        pictures[name] = np.stack([load(case / f"{name}-{i}.exr") for i in rounds])
    behind = sky_behind(camera, sky, pictures["cycles"].shape[1])
    pictures["cycles"][..., :3] += (1 - pictures["cycles"][..., 3:]) * behind  # that film was transparent
    seconds["cycles"] = [json.load(open(case / f"cycles-{i}.json"))["seconds"] for i in rounds]
    seconds["marram"] = [marram_seconds(case / f"marram-{i}.json") for i in rounds]
    for i in rounds:
        begin, middle, end = map(float, open(case / f"process-{i}.txt").read().split())
        processes["cycles"].append(middle - begin)
        processes["marram"].append(end - middle)

    mean = {name: p.mean(0) for name, p in pictures.items()}
    alpha = {name: p[..., 3] for name, p in mean.items()}
    ball = np.minimum(alpha["cycles"], alpha["marram"]) > 0.999
    level = {name: p[ball][:, :3].mean(0) for name, p in mean.items()}
    noise = {name: math.sqrt(p[:, ball, :3].var(0, ddof=1).mean()) / level[name].mean() for name, p in pictures.items()}

    for name in mean:
        save(out / f"{case.name}-{name}.exr", mean[name][..., :3], "OPEN_EXR")
        save(case / f"{name}-seed.exr", pictures[name][0, ..., :3], "OPEN_EXR")
        save(case / f"{name}-other.exr", pictures[name][1, ..., :3], "OPEN_EXR")
    both = np.concatenate([mean["cycles"], mean["marram"]], 1)[..., :3]
    save(out / f"{case.name}.png", encoded(both), "PNG")

    least, greatest, part_noise = parts(pictures, ball, level)
    time = {name: median(s) for name, s in seconds.items()}
    return {
        "cycles_s": time["cycles"], "marram_s": time["marram"],
        "ratio": median(m / c for m, c in zip(seconds["marram"], seconds["cycles"])),
        "process_cycles_s": median(processes["cycles"]), "process_marram_s": median(processes["marram"]),
        "noise_cycles": noise["cycles"], "noise_marram": noise["marram"],
        "noise_at_equal_time": noise["marram"] / noise["cycles"] * math.sqrt(time["marram"] / time["cycles"]),
        "brightness": level["marram"].mean() / level["cycles"].mean(),
        "brightness_rgb": (level["marram"] / level["cycles"]).tolist(),
        "part_least": least, "part_greatest": greatest, "part_noise": part_noise,
        "silhouette": abs(alpha["marram"] - alpha["cycles"]).sum() / alpha["cycles"].sum(),
        "flip": flip(marram, out / f"{case.name}-marram.exr", out / f"{case.name}-cycles.exr", out / case.name),
        "flip_seeds": flip(marram, case / "cycles-seed.exr", case / "cycles-other.exr"),
        "seconds": seconds, "processes": processes,
    }


columns = [  # heading, key, format
    ("Cycles s", "cycles_s", "{:.2f}"), ("Marram s", "marram_s", "{:.2f}"), ("ratio", "ratio", "{:.3f}"),
    ("process: C", "process_cycles_s", "{:.2f}"), ("M", "process_marram_s", "{:.2f}"),
    ("noise: C", "noise_cycles", "{:.4f}"), ("M", "noise_marram", "{:.4f}"), ("equal time", "noise_at_equal_time", "{:.3f}"),
    ("brightness", "brightness", "{:.4f}"), ("parts: from", "part_least", "{:.3f}"), ("to", "part_greatest", "{:.3f}"),
    ("+-", "part_noise", "{:.3f}"), ("silhouette", "silhouette", "{:.4f}"),
    ("FLIP", "flip", "{:.4f}"), ("of seeds", "flip_seeds", "{:.4f}"),
]
legend = """
Times "render" and "process" as at the head of run, medians; ratio: Marram over Cycles (goal: 0.5), the median of the rounds'.
noise: of one picture, over the ball's brightness; equal time: Marram's over Cycles' at equal time (goal: below 1).
brightness: Marram's mean over the ball, over Cycles'; parts: the same of squares of an eighth of the picture's side, and the
deviation that noise alone gives such a square: why they differ is at the head of run. silhouette: difference of alpha, over alpha.
FLIP: between the means of all rounds; of seeds: between two of Cycles' own pictures, which is noise alone.
"""


def main(ball_path, cases, marram, out):
    camera = tomllib.load(open(ball_path, "rb"))["camera"]
    sky = load(Path(ball_path).with_name("sky.exr"))[:, 0, :3]
    results = {}
    for case in sorted(Path(cases).iterdir(), key=lambda c: (int(c.name.split("-")[0]), c.name.split("-")[1] != "round")):
        rounds = range(1, 1 + len(list(case.glob("process-*.txt"))))
        results[case.name] = measure(case, rounds, sky, camera, marram, Path(out))

    rows = [["strands", "shape"] + [heading for heading, _, _ in columns]]
    for name, result in results.items():
        rows.append(name.split("-") + [form.format(result[key]) for _, key, form in columns])
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    table = "\n".join("  ".join(cell.rjust(width) for cell, width in zip(row, widths)) for row in rows)
    Path(out, "table.txt").write_text(table + "\n" + legend)
    Path(out, "table.json").write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main(*sys.argv[sys.argv.index("--") + 1:])
