"""Which prompts of other text-to-motion models the parser understands: python -m validation.motions.prompts FOLDER

FOLDER holds prompt files: .txt with a prompt a line ("text#frames"), .json with the keys text or texts.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions import Step, parse_description


def prompts(folder: Path) -> list[str]:
    """The prompts of all files below a folder, each once."""
    found: list[str] = []
    for path in sorted(folder.rglob("prompts*.txt")):
        found += [line.partition("#")[0].strip() for line in path.read_text("utf-8").splitlines()]
    for path in sorted(folder.rglob("*.json")):
        try:
            values = json.loads(path.read_text("utf-8"))
        except ValueError:
            continue
        if isinstance(values, dict):
            found += values.get("texts", [values["text"]] if "text" in values else [])
    return list(dict.fromkeys(each for each in found if each))


def _told(step: Step) -> str:
    values = (getattr(step, name) for name in Step.model_fields)
    return " ".join(str(value) for value in values if value not in (None, "normal"))


def main(folder: Path) -> None:
    """Prints each prompt with its class and steps, or why it was refused."""
    refused = 0
    found = prompts(folder)
    for prompt in found:
        try:
            parsed = parse_description(prompt)
        except InputError as error:
            refused += 1
            print(f"- {prompt}\n    {error}")
            continue
        steps = " > ".join(_told(step) for step in parsed.description.steps)
        print(f"+ {prompt}\n    {parsed.description.activity}: {steps} {parsed}")
    print(f"{len(found) - refused} of {len(found)} prompts were understood")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
