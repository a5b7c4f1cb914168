"""Covariances are taken as they are or refused: against matrices that are, or are not, made of causes."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from pydantic_core import PydanticCustomError

from aerodft.adapters.config import load_covariance
from aerodft.adapters.config.covariance import check_covariance, symmetric
from aerodft.errors import InputError

SCALES = np.array([2.0, 2.0, 0.1, 5e-3, 5e-3, 2e-3])  # metres and radians


def refused(rows, size=6):
    with pytest.raises(PydanticCustomError) as caught:
        check_covariance(rows, size, "a, b")
    return str(caught.value)


def accepted(rows):
    check_covariance(rows, len(rows), "")
    return symmetric(rows)


def made(rank, seed):
    """A covariance of six errors with so many causes."""
    root = SCALES[:, None] * np.random.default_rng(seed).normal(size=(6, rank))
    return root @ root.T


@given(rank=st.integers(1, 8), seed=st.integers(0, 2**32 - 1))
def test_what_is_made_of_causes_is_a_covariance_singular_or_not(rank, seed):
    cov = made(rank, seed)
    assert_array_equal(accepted(cov), (cov + cov.T) / 2)
    printed = [[float(f"{value:.9g}") for value in row] for row in cov]
    accepted(printed)


@given(
    rank=st.integers(1, 8),
    seed=st.integers(0, 2**32 - 1),
    below=st.floats(1e-4, 0.5),
    direction=st.lists(st.floats(-1, 1), min_size=6, max_size=6).filter(lambda each: np.linalg.norm(each) > 0.1),
)
def test_a_combination_with_a_negative_variance_is_refused(rank, seed, below, direction):
    cov = made(rank, seed)
    scale = np.sqrt(np.diag(cov))
    towards = np.array(direction) / np.linalg.norm(direction)
    correlations = cov / np.outer(scale, scale)
    excess = towards @ correlations @ towards + below * len(cov)  # for sure below 0 along it, also when normalised
    rows = np.outer(scale, scale) * (correlations - excess * np.outer(towards, towards))
    sentence = refused(rows)
    assert "eigenvalue of -" in sentence or "expected variances of 0 or more" in sentence


def test_what_is_exact_has_no_variance_and_no_covariance():
    cov = np.diag([0.0, 0.0, 0.01, 1e-6, 1e-6, 0.0])
    assert_array_equal(accepted(cov), cov)
    assert_array_equal(accepted(np.zeros((4, 4))), np.zeros((4, 4)))


@pytest.mark.parametrize(
    ("rows", "sentence"),
    [
        ([[1.0, 0.0]], "got 1 row, expected 2 rows of 2 numbers (a, b)"),
        ([[1.0, 0.0], [0.0]], "got 1 in [1], expected 2 rows of 2 numbers (a, b)"),
        ([[1.0, 0.2], [0.3, 1.0]], "got [0][1] = 0.2 and [1][0] = 0.3, expected the same number twice: it is symm"),
        ([[1.0, 0.0], [0.0, -0.25]], "got [1][1] = -0.25, expected variances of 0 or more on its diagonal"),
        ([[1.0, 2.0], [2.0, 1.0]], "got correlations with an eigenvalue of -1, expected none below 0"),
        ([[0.0, 0.0], [0.0, 1.0], [0.0, 0.0]], "got 3 rows, expected 2 rows of 2"),
    ],
)
def test_the_sentence_says_where_it_is_wrong(rows, sentence):
    assert sentence in refused(rows, size=2)


def test_what_is_exact_varies_with_nothing():
    assert "got [0][1] = " in refused([[0.0, 1e-9], [1e-9, 4.0]], size=2)


def test_a_file_of_rows(tmp_path):
    path, cov = tmp_path / "cov.json", made(3, 1)
    path.write_text(json.dumps(cov.tolist()))
    assert_array_equal(load_covariance(path), (cov + cov.T) / 2)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"\xff\xd8\xff\xe0", "cov.json: not JSON: got a JPEG image, expected a JSON list of rows"),
        (b"", "cov.json: not JSON: got an empty file, expected a JSON list of rows"),
        (b"{}", "cov.json: covariance: got a table, expected a list"),
        (b"[]", "cov.json: covariance: got 0 rows, expected 6 rows of 6 numbers (east, north, up, then rotation"),
        (b"[[]]", "cov.json: covariance: got 1 row, expected 6 rows of 6 numbers"),
        (b"[1, 2]", "cov.json: covariance[0]: got 1, expected a list"),
        (b'[[1, "2"]]', 'cov.json: covariance[0][1]: got "2", expected a number'),
        (b"[[1, true]]", "cov.json: covariance[0][1]: got true, expected a number"),
        (b"[[1e200]]", "cov.json: covariance[0][0]: got 1e+200, expected at most 1e+12"),
        (b"[[1, 0], [0, 1]]", "cov.json: covariance: got 2 rows, expected 6 rows of 6 numbers"),
        (b"[[NaN]]", "cov.json: not JSON"),
    ],
)
def test_a_wrong_file_is_refused_in_one_sentence(tmp_path, content, sentence):
    path = tmp_path / "cov.json"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        load_covariance(path)
    assert sentence in str(caught.value)
    assert caught.value.exit_code == 3


def test_a_missing_file_is_said(tmp_path):
    with pytest.raises(InputError, match=r"none\.json: the covariance cannot be read: got unreadable"):
        load_covariance(tmp_path / "none.json")
    with pytest.raises(InputError, match="the covariance cannot be read: got a folder, expected a JSON list of rows"):
        load_covariance(tmp_path)
