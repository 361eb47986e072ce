"""A model whose constants are another machine's, with its seal made anew."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from model_cases import fitted, refused, sealed

from gpmodel.application.model_file import load_model, model_text


def changed_by(content: dict[str, Any], name: str, value: float) -> list[dict[str, Any]]:
    assert any(effect["name"] == name for effect in content["effects"])
    return [e | {"value": value} if e["name"] == name else e for e in content["effects"]]


def test_constants_of_another_machine_are_refused_whoever_sealed_them(tmp_path: Path) -> None:
    content = dict(json.loads(model_text(fitted("load")[0])))
    path = tmp_path / "model.json"
    far = changed_by(content, "J3 Tx", 5.0)
    refused(sealed(content, effects=far), "'J3 Tx' is 5 m; expected at most 3.49 m", path)
    refused(sealed(content, effects=changed_by(content, "J3 Rx", 4.0)), "'J3 Rx' is 4 rad; expected at most 3.14", path)
    near = changed_by(content, "J3 Tx", 2.0)
    refused(sealed(content, effects=near), "its constants miss half of the poses they were fitted to by", path)
    soft = [e | {"value": 1e4 * e["value"]} if e["terms"][0]["basis"] != "1" else e for e in content["effects"]]
    refused(sealed(content, effects=soft), "expected at most 0.871 m, beyond which it is another machine", path)
    there = np.array(content["registration"][""])
    there[0, 3] += 5.0
    refused(sealed(content, registration={"": there.tolist()}), "miss half of the poses they were fitted to", path)
    elsewhere = content["measured"] | {"labels": {"setup": ["elsewhere"] * 40}}
    refused(sealed(content, measured=elsewhere), "measured.labels: setup 'elsewhere'", path)
    for unseen in (None, content["measured"] | {"heldout": [*range(40)]}):
        path.write_text(sealed(content, effects=near, measured=unseen))
        load_model(path)
