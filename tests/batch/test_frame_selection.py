"""Frame lists and chunks."""

import argparse

import pytest
from livehand.backend.batch.frame_selection import parse_chunk, parse_frames


def test_frames_are_read_in_order_and_once_each():
    assert parse_frames("1-3,30, 2") == (1, 2, 3, 30)
    assert parse_frames("-2-1") == range(-2, 2)


def test_all_of_blenders_frames_are_a_range():
    frames = parse_frames("-1048574-1048574")
    assert parse_chunk("1000000/1000000").of(frames) == range(1048572, 1048575)


@pytest.mark.parametrize("text", ["", "1-", "5-3", "a", "1,,2", "1.5", "1-99999999999", "99999999", "-1048575-1"])
def test_malformed_frames_are_an_error(text):
    with pytest.raises(argparse.ArgumentTypeError, match="must"):
        parse_frames(text)


@pytest.mark.parametrize("text", ["", "1", "0/2", "3/2", "1/0", "-1/2", "1/2/3", "a/b"])
def test_malformed_chunks_are_an_error(text):
    with pytest.raises(argparse.ArgumentTypeError, match="must be I/N"):
        parse_chunk(text)


@pytest.mark.parametrize("frames", [range(1, 25), range(1, 3), [5, 1, 9]])
@pytest.mark.parametrize("count", [1, 2, 3, 7, 24])
def test_chunks_are_consecutive_equal_in_length_and_complete(frames, count):
    chunks = [parse_chunk(f"{number}/{count}").of(frames) for number in range(1, count + 1)]
    assert [frame for chunk in chunks for frame in chunk] == list(frames)
    assert max(map(len, chunks)) - min(map(len, chunks)) <= 1
