"""Test folds of consecutive rows, and their acceptance rule for findings."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from residual_cases import pool, seen

from gpmodel.evidence.cross_validation import better_by
from gpmodel.evidence.dependence import order_matters
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import effect_at
from gpmodel.table.blocks import stretches


def test_stretches_are_neighbours_of_nearly_equal_number() -> None:
    row = np.random.default_rng(0).permutation(47).astype(float)
    code = stretches(row, 10)
    assert (np.diff(code[np.argsort(row)]) >= 0).all()
    assert set(np.bincount(code)) == {4, 5}


def test_each_fold_is_one_stretch_and_no_unit_is_parted() -> None:
    residual = seen("nothing")
    doubled = replace(residual, block_of_pose=residual.block_of_pose // 2)
    there = doubled.contiguous_folds
    fold = np.zeros(len(there.poses), dtype=int)
    fold[there.problem.pose_of_row] = there.fold_of_row
    for code in np.unique(doubled.block_of_pose):
        assert len(set(fold[doubled.block_of_pose == code])) == 1
    rows = [there.poses.states["row"][fold == k] for k in np.unique(fold)]
    assert len(rows) == residual.criteria.folds
    assert all(a.max() < b.min() for a, b in pairwise(rows))


def test_what_happened_once_predicts_no_stretch_that_was_left_out() -> None:
    once = effect_at("once", "base", "Tx", Expression("exp(-((row - 41)/1.5)*((row - 41)/1.5))"))
    own = Candidate("once", (once,), "", 4.0)
    there = seen("nothing")
    target = there.target.copy()
    target[: there.measured] += 3e-4 * there.columns([once])[:, 0]
    there = replace(there, target=target, values=there.span.remove(target))
    assert order_matters(there, own)
    assert better_by(there, own.effects) > 2.0
    assert better_by(there.contiguous_folds, own.effects) < 2.0


@pytest.mark.parametrize("name", ["coupling, J4 to J5", "gear error, 2 per turn, J4"])
def test_what_is_no_matter_of_rows_is_predicted_as_well_in_stretches(name: str) -> None:
    own = next(c for c in pool() if c.name == name)
    assert not order_matters(seen(name), own)
    random, stretched = better_by(seen(name), own.effects), better_by(seen(name).contiguous_folds, own.effects)
    assert stretched > 0.6 * random > 2.0
