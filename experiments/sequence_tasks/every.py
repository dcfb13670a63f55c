"""All tasks, by name."""

from __future__ import annotations

from collections.abc import Callable

from ..settings.peers_config import PeersConfig
from .copy import Copy
from .gap import Gap
from .recall import Recall
from .returning import Returning
from .task import Task

TASKS: dict[str, Callable[[PeersConfig], Task]] = {
    "recall": lambda cfg: Recall(cfg.recall),
    "copy": lambda cfg: Copy(cfg.copy),
    "gap": lambda cfg: Gap(cfg.gap),
    "returning": lambda cfg: Returning(cfg.returning),
}
