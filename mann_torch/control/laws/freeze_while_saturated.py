"""Freezing while the input is at its limit."""

from __future__ import annotations

from ...errors import ConfigError
from .drive import Drive
from .part import Gate


class FreezeWhileSaturated(Gate):
    """Nothing moves in samples whose input is cut: any number of sat(u) - u is not 0.

    What an error says there the limit has said, not the parameters: conditional adaptation, as
    Karason and Annaswamy 1994 compare with. It has no constant.
    """

    @property
    def needs(self) -> frozenset[str]:
        """What the limit takes away."""
        return frozenset({"excess"})

    def forward(self, drive: Drive) -> Drive:
        """With a share (...,) of 0 where the input is cut."""
        if drive.excess is None:
            raise ConfigError(
                "FreezeWhileSaturated needs the excess, which the drive does not hold"
            )
        free = (drive.excess.abs().amax(dim=-1) <= 0.0).to(drive.error.dtype)
        return drive._replace(share=free if drive.share is None else drive.share * free)
