"""Tables of poses made fit for a saved model."""

from dataclasses import replace

import numpy as np

from gpmodel.application.kinematics import tips
from gpmodel.application.model_file import SavedModel
from gpmodel.arrays import Array, Mask
from gpmodel.checks.mixed_up import FEWEST_OF_A_PART, MOST_ROWS, POOR_LENGTH, comparable_rows, mixed_up, typical
from gpmodel.errors import InputError, choices
from gpmodel.mechanism.branches import branched
from gpmodel.mechanism.source import choice_of
from gpmodel.model.memory import read_by
from gpmodel.model.states import states_of
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.table.bundles import SAME_JOINT
from gpmodel.table.dataset import Dataset, with_payload


def matched(saved: SavedModel, dataset: Dataset) -> Dataset:
    """`dataset` made fit for the model: its payload, and labels that name the model's set-ups and tools.

    Raises InputError: a set-up or tool the model does not know, an input missing or in another unit.
    """
    for name, unit in saved.input_units.items():
        if name not in dataset.extras:
            raise InputError(f"{dataset.source}: column '{name} [{unit}]' is missing; the model reads it")
        if dataset.extra_units[name] != unit:
            given = dataset.extra_units[name]
            raise InputError(f"{dataset.source}: column '{name}' is in [{given}]; the model was made with [{unit}]")
    if not dataset.payload_given:
        dataset = with_payload(dataset, choice_of(saved.mechanism).payload)
        read = {name for effect in saved.model.effects for name in effect.inputs}
        if "payload" in read:
            raise InputError(f"{dataset.source}: column 'payload [kg]' is missing; the model reads it")
    labels = dict(dataset.labels)
    for column, known in (("setup", saved.placement.registration), ("tool", saved.placement.tool)):
        labelled = set(dataset.label(column).tolist())
        if labelled == {""} and len(known) == 1:
            labels[column] = np.full(len(dataset), next(iter(known)))
        elif surplus := sorted(labelled - set(known)):
            expected = choices(surplus[0], (f"'{k}'" for k in known))
            raise InputError(f"{dataset.source}: {column} '{surplus[0]}' is unknown to the model; expected {expected}")
    return replace(dataset, labels=labels)


def matched_with_readings(saved: SavedModel, dataset: Dataset) -> Dataset:
    """`dataset` as `matched`, where its joint values and positions, if it has any, are of the model's machine.

    Raises InputError as `matched`, and where a registration and tool point of their own leave POOR_LENGTH of most
    positions.
    """
    if mixed := mixed_up(saved.mechanism, dataset):
        raise InputError(f"{dataset.source}: {mixed}; the model is one of {saved.mechanism.name}")
    fitting, rows = matched(saved, dataset), comparable_rows(dataset)
    rows = rows[:: max(1, len(rows) // MOST_ROWS)]
    known = all(joint.measured for joint in saved.mechanism.joints) and not branched(saved.mechanism)
    if known and len(rows) >= FEWEST_OF_A_PART:
        with np.errstate(all="ignore"):  # an effect that is no number there is named where it is asked for
            frames = tips(saved, fitting.subset(rows), nominal=False)[1].tip
        if not np.isfinite(frames).all():
            return fitting
        most, errors = typical(frames, dataset.position[rows])
        if (left := root_mean_square(errors[most])) > POOR_LENGTH:
            raise InputError(
                f"{dataset.source}: the positions are of another machine: the model of {saved.mechanism.name} leaves "
                f"{1e3 * left:.3g} mm of them with a registration and tool point of their own; expected less than "
                f"{1e3 * POOR_LENGTH:g} mm"
            )
    return fitting


def remembered(saved: SavedModel, dataset: Dataset) -> Dataset:
    """`dataset` with what its rows inherit from those before, as far as the model reads it, as columns of its own.

    Joint values that are then changed by a fraction of a degree, in some of the rows, come from the same side still.
    Raises InputError where nothing says that the rows are in order.
    """
    read = {name for effect in saved.model.effects for name in effect.inputs if read_by(name)}
    inherited = sorted(read - set(dataset.extras))
    if not inherited:
        return dataset
    states = states_of(saved.mechanism, dataset)
    return replace(
        dataset,
        extras={**dataset.extras, **{name: states[name] for name in inherited}},
        extra_units={**dataset.extra_units, **dict.fromkeys(inherited, "1")},
    )


def turned(saved: SavedModel, nominal: Array, corrected: Array) -> Mask:
    """Targets (N,) that a joint whose last move the model reads comes to from another side than without correction."""
    read = {source for effect in saved.model.effects for name in effect.inputs for source in read_by(name)}
    out = np.zeros(len(nominal), dtype=bool)
    for j, joint in enumerate(saved.mechanism.joints):
        if joint.name in read:
            before, after = (np.diff(values[:, j]) for values in (nominal, corrected))
            sides = [np.where(np.abs(move) > SAME_JOINT, np.sign(move), 0.0) for move in (before, after)]
            out[1:] |= sides[0] != sides[1]
    return out
