"""What methods of coarse alignment share whose base stays on the spot."""

from __future__ import annotations

import numpy as np

from sins_env.arrays import Mask
from sins_env.types import NavState


class OnTheSpot:
    """Base of the methods for a base that stays on the spot."""

    travels: Mask = np.array(False)  #: in which runs (...) the base travels, so that nothing told of one at rest holds
    due: Mask = np.array(True)  #: in which runs the fine phase may begin once the coarse phase is over

    def state(self, nav: NavState) -> NavState:
        """Return the state of the INS, of which the last fix has told velocity and place."""
        return nav
