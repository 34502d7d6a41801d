# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the writers of image files without Blender: readers find the same numbers, whatever the size, and files are small."""

import os
import struct
import tempfile
import threading
import time
import zlib
from pathlib import Path

import numpy as np
import pytest

from addon.core import threads
from addon.core.errors import BakeError
from addon.output import png_writer, value_encoding, write_queue
from addon.output.atomic_file import Partial
from addon.output.write_queue import MOST_UNFINISHED, Content, WriteQueue

SIZES = [(1, 1), (1, 7), (300, 1), (2, 3), (17, 33), (129, 65)]


def texels_of(width, height, seed):
    """Slow waves with a bit of noise, some background, and the values 0 and 1; some are outside by rounding."""
    random = np.random.default_rng(seed)
    u, v = np.meshgrid(np.arange(width) / 40, np.arange(height) / 30)
    result = np.stack([np.sin(u + k) * np.cos(v - k) * 0.5 + 0.5 for k in range(4)], axis=-1).astype(np.float32)
    result += random.normal(0, 1e-4, result.shape).astype(np.float32)
    result[random.random((height, width)) > 0.8] = (0.5, 0.5, 1.0, 0.0)
    result[0, 0], result[-1, -1] = (0.0, 1.0, -1e-6, 1.0 + 1e-6), (1.0, 0.0, 0.5, 0.25)
    return result


def stored(texels, depth, has_alpha):
    """The whole numbers (H, W, C) of `texels`, with the highest row first."""
    most = 2**depth - 1
    exact = texels[::-1, :, : 4 if has_alpha else 3] * np.float32(most) + np.float32(0.5)
    return np.floor(exact).clip(0, most).astype(int)


def file_of(made):
    """The bytes of a content."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "file")
        made.write(path, (part() for part in made.parts))
        return path.read_bytes()


# PNG


def png_chunks(data):
    """The names and the data of the chunks of a PNG, after their checksums were compared."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, found = 8, []
    while at < len(data):
        length, name = struct.unpack_from(">I4s", data, at)
        body = data[at + 8 : at + 8 + length]
        assert struct.unpack_from(">I", data, at + 8 + length)[0] == zlib.crc32(name + body)
        found.append((name, body))
        at += 12 + length
    return found


def png_numbers(data):
    """The numbers (H, W, C) of a PNG whose rows all have the filter Paeth, by the plain rule of the specification."""
    chunks = png_chunks(data)
    width, height, depth, kind, *rest = struct.unpack(">2I5B", chunks[0][1])
    assert rest == [0, 0, 0]
    channels = {6: 4, 2: 3, 4: 2, 0: 1}[kind]
    texel = channels * depth // 8
    # decompress compares the checksum of the stream
    rows = np.frombuffer(zlib.decompress(b"".join(body for name, body in chunks if name == b"IDAT")), np.uint8)
    rows = rows.reshape(height, 1 + width * texel)
    assert (rows[:, 0] == 4).all()
    found = np.zeros((height + 1, texel + width * texel), int)
    for y in range(height):
        for x in range(texel, texel + width * texel):
            left, above, corner = found[y + 1, x - texel], found[y, x], found[y, x - texel]
            guess = left + above - corner
            near = min((left, above, corner), key=lambda value: abs(guess - value))  # the first of equal ones
            found[y + 1, x] = (rows[y, 1 + x - texel] + near) % 256
    values = found[1:, texel:].astype(np.uint8).view(np.uint8 if depth == 8 else ">u2")
    return values.reshape(height, width, channels).astype(int)


@pytest.mark.parametrize("has_alpha", [True, False], ids=["RGBA", "RGB"])
@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("size", SIZES, ids=str)
def test_a_png_has_the_numbers_seed_4(size, depth, has_alpha):
    texels = texels_of(*size, seed=4)
    data = file_of(png_writer.content(texels, depth, has_alpha=has_alpha))
    np.testing.assert_array_equal(png_numbers(data), stored(texels, depth, has_alpha))


@pytest.mark.parametrize("has_alpha", [True, False], ids=["gray with alpha", "gray"])
@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("size", SIZES, ids=str)
def test_a_gray_png_has_the_numbers_of_red_seed_4(size, depth, has_alpha):
    texels = texels_of(*size, seed=4)
    data = file_of(png_writer.content(texels, depth, has_alpha=has_alpha, is_gray=True))
    wanted = stored(texels, depth, True)[..., [0, 3] if has_alpha else [0]]
    np.testing.assert_array_equal(png_numbers(data), wanted)


@pytest.mark.parametrize("depth", [8, 16])
def test_noise_needs_every_branch_of_the_filter_seed_5(depth):
    texels = np.random.default_rng(5).random((40, 50, 4), dtype=np.float32)
    texels[10:20] = np.round(texels[10:20] * 2) / 2  # many equal bytes
    data = file_of(png_writer.content(texels, depth, has_alpha=True))
    np.testing.assert_array_equal(png_numbers(data), stored(texels, depth, True))


@pytest.mark.parametrize("has_alpha", [True, False], ids=["RGBA", "RGB"])
def test_small_blocks_and_pieces_give_the_same_numbers_seed_6(has_alpha, monkeypatch):
    """Rows need the row above, also in another block; pieces are joined in one stream."""
    texels = texels_of(45, 61, seed=6)
    whole = file_of(png_writer.content(texels, 16, has_alpha=has_alpha))
    assert [name for name, _ in png_chunks(whole)].count(b"IDAT") == 3  # the header, one piece, the checksum
    monkeypatch.setattr(write_queue, "PREPARED_BYTES", 3 * 45 * 8)
    monkeypatch.setattr(png_writer, "LEAST_PIECE", 1)
    monkeypatch.setattr(png_writer, "MOST_PIECE", 1000)
    split = file_of(png_writer.content(texels, 16, has_alpha=has_alpha))
    assert [name for name, _ in png_chunks(split)].count(b"IDAT") > 20
    for data in (whole, split):
        np.testing.assert_array_equal(png_numbers(data), stored(texels, 16, has_alpha))


def test_a_png_has_the_numbers_in_whatever_order_blocks_come_seed_7(monkeypatch):
    """A thread that had another block before prepares the first one, above which there is no row."""

    def in_reverse(height, row_bytes, work):
        work(iter([slice(start, start + 10) for start in range(height - 10, -1, -10)]))

    monkeypatch.setattr(png_writer, "for_rows", in_reverse)
    texels = np.random.default_rng(7).random((30, 20, 4), dtype=np.float32)
    data = file_of(png_writer.content(texels, 16, has_alpha=True))
    np.testing.assert_array_equal(png_numbers(data), stored(texels, 16, True))


@pytest.mark.parametrize("is_color", [True, False])
def test_a_png_of_colors_declares_their_space_before_its_data(is_color):
    """Programs that follow the declaration would change data."""
    made = png_writer.content(texels_of(9, 9, 1), 8, has_alpha=True, is_color=is_color)
    declared = [b"sRGB", b"gAMA", b"cHRM"] if is_color else []
    names = [name for name, _ in png_chunks(file_of(made))]
    assert names == [b"IHDR", *declared, b"IDAT", b"IDAT", b"IDAT", b"IEND"]


# Deflating


@pytest.mark.parametrize("count", [1, 2, 5])
def test_the_checksum_of_pieces_is_that_of_the_whole_seed_8(count):
    data = np.random.default_rng(8).integers(0, 256, (count, 70001), dtype=np.uint8)
    pieces = [png_writer.deflate(row, png_writer.RUNS, is_last=number == count - 1) for number, row in enumerate(data)]
    adler = 1
    for piece in pieces:
        adler = png_writer.joined(adler, piece)
    assert adler == zlib.adler32(data)


@pytest.mark.parametrize("search", png_writer.SEARCHES.values())
def test_repeats_are_sought_where_they_help_seed_9(search):
    """Gray maps repeat each number three times; residues of normals hardly repeat."""
    random = np.random.default_rng(9)
    gray = np.repeat(random.normal(0, 9, (300, 400, 1)).astype(np.int8), 3, axis=2).view(np.uint8).reshape(300, -1)
    residues = random.normal(0, 20, (300, 1200)).astype(np.int8).view(np.uint8)
    constant = np.zeros((300, 1200), np.uint8)
    tiled = np.tile(random.integers(0, 256, (300, 30), dtype=np.uint8), 40)
    for rows, repeats in ((gray, True), (residues, False), (constant, False), (tiled, True)):
        method = png_writer.choose(rows, search)
        assert method == (png_writer.Method(search.level, zlib.Z_DEFAULT_STRATEGY) if repeats else png_writer.RUNS)
        usual = len(zlib.compress(rows.tobytes(), search.level))
        assert len(png_writer.deflate(rows, method, is_last=True).data) <= 1.1 * usual


def test_few_bytes_are_tried_once_seed_13():
    """Bytes that are tried twice repeat each other."""
    noise = np.random.default_rng(13).integers(0, 256, (3, 700), dtype=np.uint8)
    assert png_writer.choose(noise, png_writer.SEARCHES[16]) == png_writer.RUNS


def test_many_bytes_are_tried_over_several_rows_seed_14():
    """In wide maps, the row above is farther away than the least sample is long."""
    pairs = np.random.default_rng(14).integers(0, 256, (512, png_writer.LEAST_SAMPLE), dtype=np.uint8)
    search = png_writer.SEARCHES[16]
    assert png_writer.choose(np.repeat(pairs, 2, axis=0), search).level == search.level
    assert png_writer.choose(np.repeat(pairs[:16], 2, axis=0), search) == png_writer.RUNS


@pytest.mark.parametrize("cores", [1, 2, 8])
def test_each_processor_gets_a_piece_of_all_rows(cores, monkeypatch):
    monkeypatch.setattr(threads, "processors", lambda: cores)
    assert len(png_writer.pieces(1000, 8192)) == cores
    assert len(png_writer.pieces(1000, 4)) == 1


@pytest.mark.parametrize("height", [1, 5, 1000, 4096])
@pytest.mark.parametrize("row_bytes", [1, 4096, 1 << 20])
def test_pieces_cover_all_rows_in_order(height, row_bytes):
    found = png_writer.pieces(height, row_bytes)
    assert [row for part in found for row in range(height)[part]] == list(range(height))
    assert all(row_bytes * (part.stop - part.start) <= png_writer.MOST_PIECE for part in found)


# The queue


def slow_content(data, log=None):
    """A content of one part. log: gets the data when it is packed."""

    def part():
        if log is not None:
            log.append(data)
        time.sleep(0.02)
        return data

    return Content([part], lambda path, results: path.write_bytes(b"".join(results)))


def reserved(path):
    partial = Partial(path)
    partial.temporary.touch()
    return partial


def test_a_queue_writes_each_file(tmp_path):
    partials = [reserved(tmp_path / f"{number}.png") for number in range(7)]
    with WriteQueue() as queue:
        jobs = [queue.add(lambda n=number: slow_content(b"%d" % n), partial) for number, partial in enumerate(partials)]
        for job in jobs:
            job.result()
    assert [partial.temporary.read_bytes() for partial in partials] == [b"%d" % number for number in range(7)]
    for partial in partials:
        partial.discard()
    assert os.listdir(tmp_path) == []


def test_few_files_are_in_memory_at_once(tmp_path):
    """The next one is made when the first is finished."""
    jobs, partials = [], [reserved(tmp_path / f"{number}.png") for number in range(5)]

    def make():
        assert all(job.done() for job in jobs[: len(jobs) + 1 - MOST_UNFINISHED])
        return slow_content(bytes(1000))

    with WriteQueue() as queue:
        for partial in partials:
            jobs.append(queue.add(make, partial))
    for partial in partials:
        partial.discard()


def test_files_are_written_one_after_the_other(tmp_path):
    running, most = [], []

    def write(path, _results):
        running.append(path)
        most.append(len(running))
        time.sleep(0.05)
        running.pop()

    with WriteQueue() as queue:
        for number in range(4):
            queue.add(lambda: Content([], write), reserved(tmp_path / f"{number}.png"))
    assert max(most) == 1


def test_an_error_is_raised_with_the_path_by_its_file_and_by_the_next_one(tmp_path):
    def fail(_path, _results):
        raise OSError(28, "No space left on device")

    partial = reserved(tmp_path / "map.png")
    with WriteQueue() as queue:
        job = queue.add(lambda: Content([], fail), partial)
        message = f"'{tmp_path / 'map.png'}' could not be written: No space left on device."
        with pytest.raises(BakeError) as raised:
            job.result()
        assert str(raised.value) == message
        with pytest.raises(BakeError) as raised:
            queue.add(lambda: slow_content(b"x"), reserved(tmp_path / "other.png"))
        assert str(raised.value) == message


def test_a_closed_queue_does_not_begin_what_waits(tmp_path):
    begun, let_go, log = threading.Event(), threading.Event(), []

    def wait():
        begun.set()
        let_go.wait(10)
        return b""

    queue = WriteQueue()
    many = Content([wait] * threads.processors(), lambda path, results: path.write_bytes(b"".join(results)))
    queue.add(lambda: many, reserved(tmp_path / "1.png"))
    queue.add(lambda: slow_content(b"never", log), reserved(tmp_path / "2.png"))
    assert begun.wait(10)
    threading.Timer(0.05, let_go.set).start()
    queue.close()
    queue.close()
    assert log == []


# All


def test_steps_are_the_nearest_and_stay_in_range():
    values = np.array([-1.0, -1e-9, 0.0, 0.49999 / 255, 0.50001 / 255, 1.0, 1.0 + 1e-7, 7.0], np.float32)
    assert value_encoding.steps(values, 8).tolist() == [0, 0, 0, 0, 1, 255, 255, 255]
    assert value_encoding.steps(values, 8).dtype == np.uint8
    every = (np.arange(65536) / 65535).astype(np.float32)
    np.testing.assert_array_equal(value_encoding.steps(every, 16), np.arange(65536))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("depth", [8, 16])
def test_values_that_are_no_numbers_become_steps_without_a_word(depth):
    values = np.array([np.nan, np.inf, -np.inf, 1.0], np.float32)
    most = 2**depth - 1
    assert value_encoding.steps(values, depth).tolist() == [0, most, 0, most]
