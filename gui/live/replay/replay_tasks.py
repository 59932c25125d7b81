"""What the worker process does for a replay. This module does not import Qt."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gui.widgets.typed_paths import typed_path
from rigctl.errors import WrongUse

if TYPE_CHECKING:
    from rigctl.analysis.execution.executor import Progress
    from rigctl.encoding.normalisation import Normalisation
    from rigctl.session.read.session import Session


def neuron_voltage(
    session: Session, row: int, taxel: int, ranges: Normalisation
) -> NDArray[np.float64]:
    """Return the membrane voltage of SA and RA of a taxel, from 0, float64 (n, 2) in mV."""
    from rigctl.encoding.encoder import membrane_mv
    from rigctl.encoding.normalisation import Normalisation

    samples = np.ascontiguousarray(session.samples(row)[:, [taxel]])
    own = Normalisation(ranges.low[[taxel]], ranges.high[[taxel]], ranges.source)
    return membrane_mv(samples, own)


def write_movie(
    session: Session, row: int, taxel: int, section_s: tuple[float, float], out: str, show: Progress
) -> str:
    """Write the movie of a taxel, from 0, as ``rigctl encode --movie`` does; return its path.

    ``section_s``: where the shown part of the trial begins, and its length. Raises WrongUse for an
    attempt that does not count.
    """
    from rigctl.analysis.data.cache import Resources
    from rigctl.analysis.taxel.taxel_request import TaxelRequest, encode_taxel

    if row not in session.committed():
        raise WrongUse("this attempt does not count: choose a committed one for a movie")
    request = TaxelRequest(
        (session.path,),
        trial=int(session.trials[row]["trial_id"]),
        taxel=taxel + 1,
        start_s=section_s[0],
        seconds=section_s[1],
        movie=typed_path(out),
    )
    encode_taxel(request, Resources(progress=show))
    return out
