# SPDX-License-Identifier: Apache-2.0
"""Writes scenes as TOML. Numbers have the fewest digits that give the same double (or float) back."""
import json
import math

import numpy as np


def value_text(value) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, int):
        return str(value)
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {value_text(one)}" for key, one in value.items()) + " }" if value else "{}"
    if hasattr(value, "__iter__"):
        return "[" + ", ".join(value_text(one) for one in value) + "]"
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{number} is not finite")
    if number == int(number) and abs(number) < 1e15:
        return str(int(number))
    with np.errstate(over="ignore", under="ignore"):
        single = np.float32(number)
    return str(single) if float(single) == number else repr(number)


STRAIGHT = 1e-6  # relative to the largest number: what differs less is the same, or on a straight line


def held(values: dict[int, object], frames) -> dict[int, object]:
    """Values at all of the frames: a frame without one has that of the last frame before it, else that of the first."""
    known = sorted(values)
    return {frame: values[max((one for one in known if one <= frame), default=known[0])] for frame in frames}


def over_time(values: dict[int, object]):
    """The value, if it is the same at all frames; else its keys, without those on the straight line between others."""
    frames = sorted(values)
    numbers = np.array([np.ravel(np.array(values[frame], dtype="f8")) for frame in frames])
    if np.abs(numbers - numbers[0]).max() <= STRAIGHT * np.abs(numbers).max():
        return values[frames[0]]
    kept = [0]
    for i in range(1, len(frames) - 1):  # straight from the last kept to the next?
        a, b = kept[-1], i + 1
        shares = (np.array(frames[a:b + 1]) - frames[a]) / (frames[b] - frames[a])
        line = numbers[a] + shares[:, None] * (numbers[b] - numbers[a])
        if np.abs(line - numbers[a:b + 1]).max() > STRAIGHT * np.abs(numbers[a:b + 1]).max():
            kept.append(i)
    return {"keys": [[frames[i], values[frames[i]]] for i in kept + [len(frames) - 1]]}


def table_text(heading: str, values: dict) -> str:
    """A table and its keys; keys with the value None are left out. No heading: keys before the first table."""
    lines = [heading] if heading else []
    lines += [f"{key} = {value_text(value)}" for key, value in values.items() if value is not None]
    return "\n".join(lines) + "\n"
