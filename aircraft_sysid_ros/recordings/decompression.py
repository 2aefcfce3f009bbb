"""Decompression that trusts no length: it stops as soon as there is more than was announced."""

from __future__ import annotations

from collections.abc import Iterator

from aircraft_sysid_ros.errors import echo

#: What a zstd frame begins with; no serialised ROS message does.
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
#: Bytes that go in, for zstd, or come out, for lz4, at a time: a wrong announcement reserves no memory.
_ZSTD_IN, _LZ4_OUT = 1 << 12, 1 << 20


class Undecompressible(Exception):
    """Bytes that do not decompress to what was announced; the text says why, as words after their name."""


def decompress(compression: str, content: bytes, size: int, most: int) -> bytes:
    """``content`` decompressed to ``size`` bytes, ``most`` at most; ``compression`` is zstd or lz4.

    Raises Undecompressible.
    """
    if compression not in _DECOMPRESSORS:
        raise Undecompressible(f"has the unknown compression {echo(compression)!r}")
    if size > most:
        raise Undecompressible("announces more than a file of this size can hold")
    parts, left = [], size
    try:
        for part in _DECOMPRESSORS[compression](content):
            parts.append(part)
            left -= len(part)
            if left < 0:
                break
    except Exception:  # each compressor raises its own
        raise Undecompressible("cannot be decompressed") from None
    if left:
        raise Undecompressible("does not have the length that it announces")
    return b"".join(parts)


def decompress_prefix(content: bytes, most: int) -> tuple[bytes, bool]:
    """Content of a zstd file as far as it can be decompressed, and whether that is to its end.

    Raises Undecompressible for more than ``most`` bytes.
    """
    parts: list[bytes] = []
    try:
        for part in _zstd(content):  # keeps what came before an error
            parts.append(part)
            most -= len(part)
            if most < 0:
                break
    except Exception:  # the compressor's own, or the end of a file that is cut short
        return b"".join(parts), False
    if most < 0:
        raise Undecompressible("holds more than a file of its size can")
    return b"".join(parts), True


def _zstd(content: bytes) -> Iterator[bytes]:
    """Raises EOFError where the last frame has no end."""
    import zstandard

    frame = zstandard.ZstdDecompressor().decompressobj()
    for at in range(0, len(content), _ZSTD_IN):
        left = content[at : at + _ZSTD_IN]
        while left:
            if frame.eof:
                frame = zstandard.ZstdDecompressor().decompressobj()
            yield frame.decompress(left)
            left = frame.unused_data if frame.eof else b""
    if not frame.eof:
        raise EOFError


def _lz4(content: bytes) -> Iterator[bytes]:
    """Raises EOFError where the frame has no end."""
    import lz4.frame

    frame = lz4.frame.LZ4FrameDecompressor()
    part = frame.decompress(content, _LZ4_OUT)
    while part:
        yield part
        part = b"" if frame.eof else frame.decompress(b"", _LZ4_OUT)
    if not frame.eof:
        raise EOFError


_DECOMPRESSORS = {"zstd": _zstd, "lz4": _lz4}
