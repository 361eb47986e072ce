"""Gain of parallel work, cost of distribution, and cost of many runs and many poses.

python -m experiments.scale             all of it, on an otherwise idle machine; writes results.json
python -m experiments.scale --only overhead,memory
"""

import argparse
import json
import os
import platform
from pathlib import Path

from experiments.scale.measure import MEASURED
from gpmodel.files import to_json


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default=",".join(MEASURED))
    path = Path(__file__).parent / "results.json"
    results = json.loads(path.read_text()) if path.exists() else {}
    for name in parser.parse_args().only.split(","):
        load = os.getloadavg()[0]
        results[name] = MEASURED[name]() | {"load_before": load, "cores": os.cpu_count()}
        results["machine"] = platform.machine()
        path.write_text(to_json(results))
        print(name, json.dumps(results[name]), flush=True)


if __name__ == "__main__":
    main()
