"""Examples of all public names; the page of a name shows the lines after its comment. The tests run the whole file, in
order, in a folder with the shipped table as table.csv."""

import numpy as np
import pandas as pd

import gpmodel as gp

# load_mechanism: a name, a URDF or a TOML table; payload="60 kg" where it carries one
arm = gp.load_mechanism("irb6400r")
print(arm)

# read_table: a file, or a DataFrame with the same headers
table = gp.read_table("table.csv", arm)
print(len(table), table.joints)

# Dataset: what read_table returns; immutable, SI inside
print(table.q.shape, table.position.shape, table.columns[:2])

# check: judge a table before anything is fitted to it
judged = gp.check(arm, table)
print(judged.valid)

# calibrate: registration, tool, geometry and named effects
fit = gp.calibrate(arm, table, effects=["joint_compliance J5"])
print(fit.ladder())

# Model: what was fitted; it predicts and compensates
model = fit.model
print(model)
model.save("model.json")

# load_model: from the file alone, on any machine
model = gp.load_model("model.json")
predicted = model.predict("table.csv")
corrected = model.compensate("table.csv")

# verify: a table measured afterwards: does the model hold?
frame = pd.read_csv("table.csv")
before = gp.calibrate(arm, frame[:70], effects=["joint_compliance J5"]).model
again = gp.verify(before, frame[70:], tolerance="0.2 mm")
print(again.summary())

# verify_next: the same pose by pose: what is known so far, and which pose to measure next
looked = gp.verify_next(before, frame[70:78])
print(looked.summary())

# certificate: how accurate the machine is, printed, as a page to print, and as JSON
certified = gp.certificate(again, machine="cell 4")
print(certified.summary())
certified.report("certificate")
certified.save("certificate.json")

# Search: how hard to look; runs=0 leaves evolution out
search = gp.Search(runs=0)

# Criteria: the limits of every test
strict = gp.Criteria(minimum_nats=8.0)

# discover: what the model is missing, proven on held-out poses
found = gp.discover(arm, table, holdout=0.3, seed=0, search=search, criteria=strict)
print(found.verdict)
print([finding.name for finding in found.findings])

# explain: a finding in words: place, size, cause, what to measure to be sure
print(gp.explain(found, 1).summary())

# compare: what changed between two results of one machine
print(gp.compare(fit, found).verdict)

# export: the model as URDF, DH rows, NumPy, C99, LaTeX and a grid, each with its error
exports = gp.export(fit, "exports")

# load_result: what calibrate or discover left in a folder
fit.report("calibrated")
print(gp.load_result("calibrated"))

# simulate: a table with a known truth
made = gp.simulate(arm, ["base_compliance=4e-8 rad/Nm"], poses=40, noise="0.03 mm", seed=1)
made.save("made.csv")

# choose_poses: measurement poses worth taking
poses = gp.choose_poses(arm, 12)
print(poses.to_dataframe().head())

# fleet: machines of one type, a table a machine
others = {f"M{k}": gp.simulate(arm, ["base_compliance=4e-8 rad/Nm"], poses=45, seed=k).table for k in (2, 3, 4)}
machines = gp.fleet(arm, others, effects=["base_compliance"])
print(machines.summary())

# Linear: sequences of instructions, as the thesis evolves them
sequences = gp.Linear()

# Tree: expression trees
trees = gp.Tree()

# Tournament: parents are the best of a few drawn at random
drawn = gp.Search(selection=gp.Tournament())

# Truncation: parents are drawn from the best share
best = gp.Search(selection=gp.Truncation())

# evolve: compensators and the histogram of the inputs they refer to
evolved = gp.evolve(arm, table, strategies=[sequences], runs=1, population=64, generations=3)
print(evolved.summary())

# regress: the law of any response over named columns
data = pd.DataFrame({"x": np.linspace(-2.0, 2.0, 60)})
law = gp.regress(data, 3.0 * np.sin(data["x"]) + 0.5)
print(law)

# Expression: a basis, from text
basis = gp.Expression("sin(J4) * temperature")
print(basis.inputs)

# effect_at: a place, an axis and a basis
drag = gp.effect_at("cable drag", "J4.moving", "Ry", gp.Expression("sin(J4)"))
print(gp.calibrate(arm, table, effects=[drag]).to_dataframe()["name"].tolist()[-1])

# Term: one place and axis of an effect
tilt = gp.Term("base", "Rx", gp.Expression("moment_base_x"))

# Effect: several terms under one unknown
foundation = gp.Effect("tilting foundation", (tilt, gp.Term("base", "Ry", gp.Expression("moment_base_y"))), "rad/Nm")

# Candidate: effects that are offered together, and what naming them costs in nats
offered = gp.Candidate("tilting foundation", (foundation,), "foundation", 4.0)

# catalogue: the families that come with the package
print([family.name for family in gp.catalogue][:3])


# Family: a named physical effect with a source
def cable_drag(mechanism, states):
    """One effect a joint."""
    for joint in mechanism.joints:
        shape = gp.Expression(f"sin({joint.name})")
        yield gp.effect_at(f"cable drag, {joint.name}", f"{joint.name}.moving", "Ry", shape, family="cable_drag")


family = gp.Family("cable_drag", "the hose pulls across the axis", "our own measurements, 2026", cable_drag)

# Mechanism: anything with these; a robot is one
print(isinstance(arm, gp.Mechanism), arm.slots[:3])

# Joint: name, kind, limits and what it drives
print([(joint.name, joint.kind) for joint in arm.joints])


# States: what a basis may read, a column a name
def warm_elbow(states: gp.States):
    """A basis as a Python function of the states."""
    return states["J3"] * states["row"]


# InputError: bad input, in one line that names the argument
try:
    gp.load_mechanism("no such arm")
except gp.InputError as error:
    print(error)
