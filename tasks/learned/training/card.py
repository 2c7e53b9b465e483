"""The model card of trained networks: scores of every seed, time, code, settings and limits."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from tasks.errors import TrainingError
from tasks.learned.training import run_folder as files

Run = tuple[Path, files.Description, files.FinalScores]

_LIMITS = """\
- Trained on random textures on a plane that moves in front of the camera. There are no depth edges,
  no objects that move on their own, and no sensor noise; contrast thresholds are equal in all
  pixels.
- Scores are those of held-out crops that no training sees, which are the same for every seed. They
  are not scores on scenes.
- Weights are in half precision. Scores depend a little on the processor, which may compute in
  bfloat16."""


def card(folders: Sequence[Path]) -> str:
    """Describe finished trainings."""
    parts = ["# Networks of our own"]
    alike: dict[tuple[str, str], list[Run]] = {}
    for folder in folders:
        description = files.read_description(folder)
        if not (folder / files.WEIGHTS_FILE).exists():
            raise TrainingError(
                f"{folder}: has no {files.WEIGHTS_FILE}; the training has not finished"
            )
        # What twins and seeds share.
        shared = {k: v for k, v in description.settings.items() if k not in ("light", "seed")}
        kind = description.settings["task"], f"```json\n{json.dumps(shared, indent=2)}\n```"
        alike.setdefault(kind, []).append((folder, description, files.read_scores(folder)))
    for (task, settings), runs in alike.items():
        command = f"`eres train {task} --light LIGHT --seed SEED --out FOLDER`"
        again = f"{command} with the settings below trains a network of the table again."
        parts += [f"## {task.capitalize()}", _table(runs), again, *_origins(runs), settings]
    return "\n\n".join([*parts, "## Limits", _LIMITS]) + "\n"


def _table(runs: Sequence[Run]) -> str:
    _, _, first = runs[0]
    lights = list(first.scores)
    head = ["trained on", "seed", *(f"{light}, {first.score}" for light in lights), "hours"]
    rows = [head, ["---"] * len(head)]
    for _, description, final in runs:
        settings = description.settings
        values = [f"{final.scores[light][0]:.2f}" for light in lights]
        hours = f"{final.seconds / 3600:.2f}"
        rows.append([f"{settings['light']} light", str(settings["seed"]), *values, hours])
    for k, name in enumerate(first.baselines, start=1):
        values = [f"{first.scores[light][k]:.2f}" for light in lights]
        rows.append([name, "", *values, ""])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _origins(runs: Sequence[Run]) -> list[str]:
    """Describe steps, size, device and code of the trainings, without repetition."""
    origins: dict[str, list[str]] = {}
    for folder, description, scores in runs:
        # Older trainings name only the device of their last steps, with the scores.
        origin = {"device": scores.device, **description.made_with}
        made_with = ", ".join(f"{k} {v}" for k, v in origin.items())
        megabytes = (folder / files.WEIGHTS_FILE).stat().st_size / 1e6
        steps = f"{scores.steps} steps, {megabytes:.2f} MB"
        settings = description.settings
        name = f"{settings['light']} light, seed {settings['seed']}"
        origins.setdefault(f"{steps}; {made_with}.", []).append(name)
    return [f"{'; '.join(names)}: {origin}" for origin, names in origins.items()]
