"""Files and texts that are nearly right, drawn by hypothesis: most faults hide behind a valid beginning."""

from __future__ import annotations

from hypothesis import strategies as st

#: Numbers at the edges of what fields can hold, as bytes.
EDGES = (
    b"\x00" * 8, b"\xff" * 8, b"\x7f" + b"\xff" * 7, b"\x80" + b"\x00" * 7, b"\x00\x00\xf0\x7f", b"\x00\x00\xc0\x7f",
    b"\x00" * 6 + b"\xf0\x7f", b"\x00" * 6 + b"\xf8\x7f", b"\xff\xff\xff\x7f",
)  # fmt: skip
#: What texts of people trip over.
WORDS = (
    "1e300", "-1e300", "1e-300", "nan", ".nan", ".inf", "-.inf", "1" * 400, "0", "-1", "true", "no", "null", "~", "[]",
    "{}", "[[[[", "&a [*a]", "*a", "!!python/object:os.system x", "2024-13-45", "1:1:1", "'", '"', "\x1b[2J", "\u202e",
    "\ud7ff", "x" * 5000, "(" * 300, "lag(alpha, 0.2)", "alpha**9", "../../etc/passwd", "", "\n\n", ":", ": ", "- ",
)  # fmt: skip

_CHANGE = st.tuples(
    st.sampled_from(("flip", "byte", "cut", "drop", "twice", "edge", "swap")),
    st.floats(0.0, 1.0, exclude_max=True),
    st.floats(0.0, 1.0, exclude_max=True),
    st.integers(0, 255),
)


def mutated(seed: bytes) -> st.SearchStrategy[bytes]:
    """The bytes with one to six changes."""
    return st.lists(_CHANGE, min_size=1, max_size=6).map(lambda changes: _changed(seed, changes))


def _changed(seed: bytes, changes: list[tuple[str, float, float, int]]) -> bytes:
    data = bytearray(seed)
    for kind, first, second, number in changes:
        if not data:
            break
        at, other = int(first * len(data)), int(second * len(data))
        length = 1 + number % 64
        if kind == "flip":
            data[at] ^= 1 << number % 8
        elif kind == "byte":
            data[at] = number
        elif kind == "cut":
            del data[at:]
        elif kind == "drop":
            del data[at : at + length]
        elif kind == "twice":
            data[other:other] = data[at : at + length]
        elif kind == "swap":
            data[at : at + length], data[other : other + length] = data[other : other + length], data[at : at + length]
        else:
            edge = EDGES[number % len(EDGES)]
            data[at : at + len(edge)] = edge
    return bytes(data)


def mutated_text(seed: str) -> st.SearchStrategy[str]:
    """The text with words of WORDS in place of some of its own, and lines dropped or doubled."""
    change = st.tuples(
        st.sampled_from(("word", "word", "word", "drop", "twice", "indent")),
        st.floats(0.0, 1.0, exclude_max=True),
        st.sampled_from(WORDS),
    )
    return st.lists(change, min_size=1, max_size=5).map(lambda changes: _changed_text(seed, changes))


def _changed_text(seed: str, changes: list[tuple[str, float, str]]) -> str:
    lines = seed.splitlines()
    for kind, where, word in changes:
        if not lines:
            break
        i = int(where * len(lines))
        if kind == "drop":
            del lines[i]
        elif kind == "twice":
            lines.insert(i, lines[i])
        elif kind == "indent":
            lines[i] = "  " + lines[i]
        else:
            words = lines[i].split(" ")
            words[int(where * 7919) % len(words)] = word
            lines[i] = " ".join(words)
    return "\n".join(lines) + "\n"
