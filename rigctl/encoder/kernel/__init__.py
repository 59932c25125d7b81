"""Machine-near code: whatever knows how lanes, blocks and spike bits are laid out in memory.

Other packages import these names from here, never from a module inside; see
``docs/explanation/encoder-kernel.md``.
"""

from rigctl.encoder.kernel import simd
from rigctl.encoder.kernel.constants import butterworth, max_samples_per_row, sa_constants
from rigctl.encoder.kernel.neuron_blocks import NeuronBlocks
from rigctl.encoder.kernel.prefetch import Trials, TrialViews, trial_readings
from rigctl.encoder.kernel.raster import accumulate_bins, scatter_to_trials, to_raster
from rigctl.encoder.kernel.spike_trains import TrainEncoder

__all__ = [
    "NeuronBlocks",
    "TrainEncoder",
    "TrialViews",
    "Trials",
    "accumulate_bins",
    "butterworth",
    "max_samples_per_row",
    "sa_constants",
    "scatter_to_trials",
    "simd",
    "to_raster",
    "trial_readings",
]
