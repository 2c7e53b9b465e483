"""Where a run was computed, by which command and with which configuration."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass

from tasks.study.report.finished_run import FinishedRun


@dataclass(frozen=True, slots=True)
class Provenance:
    """The environment by name, the configuration as JSON, the command if it was recorded."""

    environment: Mapping[str, str]
    config: str
    command: str | None


def provenance(run: FinishedRun) -> Provenance:
    """Collect the section."""
    config = json.dumps(run.config, indent=2, ensure_ascii=False)
    return Provenance(run.environment, config, run.environment.get("command"))
