"""Measure the gain of parallel work, and the cost of distribution, many runs and many poses.

python -m experiments.scale             all of it, on an otherwise idle machine; writes results.json
python -m experiments.scale --only overhead,memory
"""

import json
import os
import platform
from pathlib import Path

from experiments.options import parsed
from experiments.scale.measure import MEASURED
from gpmodel.files import to_json


def main() -> None:
    asked = parsed(__doc__, only=",".join(MEASURED))
    path = Path(__file__).parent / "results.json"
    results = json.loads(path.read_text()) if path.exists() else {}
    for name in asked.only.split(","):
        load = os.getloadavg()[0]
        results[name] = MEASURED[name]() | {"load_before": load, "cores": os.cpu_count()}
        results["machine"] = platform.machine()
        path.write_text(to_json(results))
        print(name, json.dumps(results[name]), flush=True)


if __name__ == "__main__":
    main()
