"""Make the pictures of README and gallery: python docs/make/pictures.py [NAME ...]

The program runs the demo and the robots of the gallery, opens their pages in headless Chromium, light and dark, and
writes docs/pictures/*.png. NAME: `demo` or robots of the gallery; by default all.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from gallery import ROBOTS
from PIL import Image

ROOT = Path(__file__).parents[2]
PICTURES = ROOT / "docs" / "pictures"
SIZE = (1200, 800)
SCHEMES = {"dark": 0, "light": 1}
"""Names in Chromium of the colour schemes of a page, light and dark."""
BROWSER = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), ""
)
COLOURS = 128
"""Number of colours of a PNG picture; a page has fewer."""


def gpmodel(*arguments: str, folder: Path) -> None:
    """Run a gpmodel command in `folder`, with docs/ available as in the repository."""
    subprocess.run([sys.executable, "-m", "gpmodel", *arguments, "--quiet"], cwd=folder, check=True)


def shoot(page: Path, name: str) -> None:
    """Save the first screen of a page as pictures/NAME-light.png and NAME-dark.png."""
    for scheme, number in SCHEMES.items():
        target = PICTURES / f"{name}-{scheme}.png"
        subprocess.run(
            [
                BROWSER, "--headless", "--no-sandbox", "--hide-scrollbars", "--use-angle=swiftshader",
                "--enable-unsafe-swiftshader", f"--blink-settings=preferredColorScheme={number}",
                "--virtual-time-budget=8000", f"--window-size={SIZE[0]},{SIZE[1]}", f"--screenshot={target}",
                page.as_uri(),
            ],
            check=True, capture_output=True,
        )  # fmt: skip
        Image.open(target).convert("RGB").quantize(COLOURS).save(target, optimize=True)


def main(names: list[str]) -> None:
    """Make all pictures, or the pictures with the given names."""
    PICTURES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "docs").symlink_to(ROOT / "docs")
        if not names or "demo" in names:
            gpmodel("demo", "--out", "demo", folder=folder)
            shoot(folder / "demo" / "report.html", "report")
            shoot(folder / "demo" / "explore.html", "explore")
            for figure in ("ladder.png", "inputs_1.png", "shape_1.png", "search.png"):
                shutil.copy(folder / "demo" / "figures" / figure, PICTURES / f"demo-{figure}")
        for robot in ROBOTS:
            if not names or robot.name in names:
                for command in robot.commands:
                    gpmodel(*command, folder=folder)
                shoot(folder / robot.name / "report.html", f"gallery-{robot.name}")


if __name__ == "__main__":
    main(sys.argv[1:])
