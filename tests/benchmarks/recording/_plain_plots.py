"""The live plots in plain pyqtgraph: a curve for each taxel, a scatter plot of the spikes."""

from __future__ import annotations

import time

import numpy as np
import pyqtgraph as pg

SIZE = (1400, 900)
SPAN, NEW, WARM_UP = 10_000, 33, 40
SPIKES_A_SAMPLE = 0.08
N_TAXELS, N_ROWS = 18, 36


class PlainPlots:
    """Force, speed, 18 traces and a 36-row raster of ten seconds, and a picture of the taxels."""

    def __init__(self) -> None:
        self.widget = pg.GraphicsLayoutWidget()
        self.widget.resize(*SIZE)
        plots = [self.widget.addPlot(row=row, col=0) for row in range(4)]
        for plot in plots:
            plot.setXRange(-10, 0, padding=0)
        self._drum = [plot.plot() for plot in plots[:2]]
        self._curves = [plots[2].plot() for _ in range(N_TAXELS)]
        for curve in self._curves:
            curve.setDownsampling(auto=True, method="peak")
            curve.setClipToView(True)
        self._raster = pg.ScatterPlotItem(size=2, pen=None, brush="b")
        plots[3].addItem(self._raster)
        self._map = pg.ImageItem()
        self.widget.addPlot(row=0, col=1, rowspan=3).addItem(self._map)
        self._rates = pg.BarGraphItem(x0=0, y=np.arange(N_ROWS), height=0.8, width=np.ones(N_ROWS))
        self.widget.addPlot(row=3, col=1).addItem(self._rates)

    def draw(self, samples: np.ndarray, spikes: np.ndarray) -> None:
        """Show (10,000, 18) samples and (10,000, 36) spikes."""
        time_s = np.arange(-SPAN, 0) / 1000
        for course in self._drum:
            course.setData(time_s[::12], samples[::12, 0])
        for taxel, curve in enumerate(self._curves):
            curve.setData(time_s, samples[:, taxel] / 1024 + taxel)
        at, row = np.nonzero(spikes)
        self._raster.setData(time_s[at], row)
        self._map.setImage(samples[-1].reshape(3, 6), autoLevels=False, levels=(0, 1023))
        self._rates.setOpts(width=spikes[-1000:].sum(axis=0))


def plain_costs_ms(frames: int, warm_up: int = WARM_UP) -> list[float]:
    """Return the processor time of each redraw in ms; a tenth of the frames, as they are slow."""
    app, random = pg.mkQApp(), np.random.default_rng(0)
    n = frames // 10 + warm_up // 10
    samples = random.normal(500, 12, (SPAN + n * NEW, N_TAXELS))
    spikes = (random.random((SPAN + n * NEW, N_ROWS)) < SPIKES_A_SAMPLE).astype(np.uint8)
    plots, costs_ms = PlainPlots(), []
    plots.widget.show()
    for frame in range(n):
        rows = slice(frame * NEW, frame * NEW + SPAN)
        began_s = time.process_time()
        plots.draw(samples[rows], spikes[rows])
        app.processEvents()
        costs_ms.append(1000 * (time.process_time() - began_s))
    plots.widget.hide()
    return costs_ms[warm_up // 10 :]
