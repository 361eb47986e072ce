"""The robots of the gallery: simulated machines with an undeclared effect."""

from dataclasses import dataclass

HOME = "docs/make"


@dataclass(frozen=True)
class Robot:
    """A machine of the gallery. planted: what `--effect` gives it. poses: measured. more: options of simulate."""

    name: str
    title: str
    mechanism: str
    planted: str
    poses: int
    more: tuple[str, ...] = ()
    search: tuple[str, ...] = ()

    @property
    def commands(self) -> tuple[list[str], list[str]]:
        """Return the arguments of `gpmodel` that simulate the machine's table, and that find the missing effect."""
        table, out = f"{self.name}.csv", self.name
        made = ["simulate", "--mechanism", self.mechanism, "--effect", self.planted, "--poses", str(self.poses)]
        made += ["--noise", "0.03mm", "--geometry-sigma", "0.3mm", "--seed", "7", *self.more, "--out", table]
        found = ["discover", table, "--mechanism", self.mechanism, "--runs", "0", "--noise", "0.03mm"]
        return made, [*found, *self.search, "--out", out]


ROBOTS = (
    Robot("irb6400r", "IRB 6400R, a base that yields", "irb6400r", "base_compliance=4e-8 rad/Nm", 90),
    Robot("ur5", "UR5, an encoder off its centre", "ur5", "eccentricity shoulder_lift_joint=200 urad", 90),
    Robot("panda", "Panda, a soft second joint", "panda", "joint_compliance panda_joint2=3e-5 rad/Nm", 100),
    Robot("xarm7", "xArm 7, an oval gear", "xarm7", "gear_harmonic joint2=300 urad", 100),
    Robot(
        "ur10", "UR10, a zero that drifts with temperature", "ur10", "thermal_zero elbow_joint=40 urad", 90,
        ("--input", "temperature [degC]=18:28"),
    ),
    Robot("spherical-joint", "The precision spherical joint, an axis that runs out", "spherical-joint",
          "axis run-out, J1 Tx, sin=0.15 mm", 60),
    Robot("hexapod", "A hexapod, one leg's screw pitch", "hexapod", "screw pitch, L1=2e-3", 80),
    Robot("rail", "An arm on a rail that is not straight", f"{HOME}/rail.toml", "straightness EXZ, X=1e-4 m", 120),
)  # fmt: skip
