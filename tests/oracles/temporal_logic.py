"""Robustness of signal temporal logic straight from its definition, on lists of samples; and random sentences.

A sentence is a nested tuple, as ("always", (0.5, 2.0), (">=", "contact_force", 5.0)). A value is asked of one sample at
a time and is None where a window of the sentence has none.
"""

import numpy as np

UNITS = {
    "contact_force": "N",
    "desired_force": "N",
    "force_error": "N",
    "torque_1[joint_2]": "N m",
    "tracking_error": "rad, m",
}
SIZES = {"N": 1.0, "N m": 1.0, "rad, m": 0.01}


def robustness(sentence, signals, step, last):
    """Robustness at sample 0, in the unit of the comparisons if they have one in common.

    Args:
        sentence: nested tuple.
        signals: lists of samples by name.
        step: from one sample to the next [s].
        last: number of the last sample that counts.
    """
    comparisons = list(_comparisons(sentence))
    one = len({_unit(c) for c in comparisons}) == 1
    sizes = {id(c): 1.0 if one else _size(c) for c in comparisons}

    return _at(sentence, 0, signals, step, last, sizes)


def _at(part, i, *run):
    """Robustness of a part at sample i."""
    if part[0] in (">=", "<=", "=="):
        signals, _, _, sizes = run
        a, b = (_number(side, signals, i) for side in part[1:])
        margin = {">=": a - b, "<=": b - a, "==": -abs(a - b)}[part[0]]
        return margin / sizes[id(part)]
    if part[0] in ("always", "eventually", "until"):
        return _over_a_window(part, i, *run)
    values = [_at(each, i, *run) for each in part[1:]]
    if None in values:
        return None
    if part[0] == "not":
        return -values[0]
    if part[0] == "implies":
        return max(-values[0], values[1])
    return min(values) if part[0] == "and" else max(values)


def _over_a_window(part, i, *run):
    word, window, *conditions = part
    _, step, last, _ = run
    begin = i + round(window[0] / step)
    end = last if window[1] is None else min(last, i + round(window[1] / step))
    found = []
    for j in range(begin, end + 1):
        values = [_at(conditions[-1], j, *run)]
        if word == "until":
            values += [_at(conditions[0], k, *run) for k in range(i, j + 1)]
        if None not in values:
            found.append(min(values))
    if not found:
        return None
    return min(found) if word == "always" else max(found)


def _comparisons(part):
    if part[0] in (">=", "<=", "=="):
        yield part
        return
    for each in part[1:]:
        if isinstance(each, tuple) and each and isinstance(each[0], str):
            yield from _comparisons(each)


def _names(side):
    if isinstance(side, str):
        return [side]
    return [name for each in side[1:] for name in _names(each)] if isinstance(side, tuple) else []


def _unit(comparison):
    return UNITS[next(name for side in comparison[1:] for name in _names(side))]


def _size(comparison):
    limits = [abs(side) for side in comparison[1:] if isinstance(side, float) and side != 0.0]
    return limits[0] if limits else SIZES[_unit(comparison)]


def _number(side, signals, i):
    if isinstance(side, str):
        return signals[side][i]
    if isinstance(side, float):
        return side
    a, *b = (_number(each, signals, i) for each in side[1:])
    return {
        "+": lambda: a + b[0],
        "-": lambda: a - b[0],
        "*": lambda: a * b[0],
        "/": lambda: a / b[0],
        "abs": lambda: abs(a),
    }[side[0]]()


def draw(rng, depth, names):
    """A random sentence.

    Args:
        rng: generator.
        depth: of words inside each other.
        names: of the signals that it may speak of.
    """
    if depth == 0 or rng.random() < 0.15:
        sides = [_side(rng, names), round(float(rng.normal(0.0, 2.0)), 2)]
        if rng.random() < 0.2:
            sides[1] = str(rng.choice(names))
        if rng.random() < 0.3:
            sides.reverse()
        return (str(rng.choice([">=", "<=", "=="], p=[0.45, 0.45, 0.1])), *sides)
    word = str(
        rng.choice(["always", "eventually", "until", "not", "and", "or", "implies"], p=[0.3, 0.3, 0.1, *[0.075] * 4])
    )
    inner = [draw(rng, depth - 1, names) for _ in range(1 if word in ("always", "eventually", "not") else 2)]
    if word in ("always", "eventually", "until"):
        begin = round(float(rng.choice([0.0, 0.0, rng.uniform(0.0, 2.0)])), 2)
        return (word, (begin, None if rng.random() < 0.4 else round(begin + float(rng.uniform(0.0, 3.0)), 2)), *inner)
    return (word, *inner)


def _side(rng, names):
    name, other = (str(rng.choice(names)) for _ in range(2))
    number = round(float(rng.normal(0.0, 2.0)), 2) or 1.0
    return [name, ("abs", ("-", name, other)), ("+", ("*", number, name), other), ("/", ("-", name, number), number)][
        rng.choice(4, p=[0.5, 0.2, 0.15, 0.15])
    ]


def text(part):
    """The sentence as it is written, with parentheses around everything."""
    if isinstance(part, str):
        return part
    if isinstance(part, float):
        return repr(part) if part >= 0 else f"(-{-part!r})"
    word = part[0]
    if word == "abs":
        return f"abs({text(part[1])})"
    if word in ("always", "eventually"):
        return f"{word}{_window(part[1])} ({text(part[2])})"
    if word == "until":
        return f"(({text(part[2])}) until{_window(part[1])} ({text(part[3])}))"
    if word == "not":
        return f"not ({text(part[1])})"
    return f"({text(part[1])}) {word} ({text(part[2])})"


def _window(window):
    begin, end = window
    return "" if (begin, end) == (0.0, None) else f"[{begin!r}, {'inf' if end is None else repr(end)}]"


def traces(rng, count):
    """Random samples (count,) of every signal."""
    return {name: np.cumsum(rng.normal(0.0, 1.0, count)) for name in UNITS}
