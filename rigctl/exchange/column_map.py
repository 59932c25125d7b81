"""The column map ``MAP.toml``: the columns of a recording, its trials, and their labels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rigctl.config.rig_config import LAYER_NAMES, MAX_TAXELS
from rigctl.config.toml_reader import TomlTable, TomlText
from rigctl.errors import ConfigError
from rigctl.exchange.labels import GRAMS, KPA, SECONDS, LabelRules, read_label_rules, read_unit
from rigctl.session.sensor_layout import SensorLayout

MIN_RATE_HZ, MAX_RATE_HZ = 1e-3, 1e7
MAX_VALUE, SMALLEST_SPAN = 1e300, 1e-100
DECIMALS, MAX_SKIPPED = (".", ","), 10_000
LOW_PASS_HZ, LOW_PASS_MAX_HZ = 400.0, 499.0


@dataclass(frozen=True, slots=True)
class ImportMap:
    """A validated map. Columns are names, numbers from 1, or ranges ``first..last`` of these.

    ``time_column`` is empty where ``rate_hz`` is given. Factors convert the values of the file
    to s and g. ``trial_column``: its values tell the trials of one file apart. ``elements``: the
    MATLAB array whose elements are trials. ``header``: whether the first row of a text table has
    names, None where its cells tell. ``missing``: numbers that stand for no reading.
    ``max_gap_s``: 0 for three times the median interval of rows. ``taxel_low``, ``taxel_high``:
    values that are stored as 0 and 65535; equal for each taxel's own lowest and highest.
    ``low_pass_hz``: cutoff of the filter before rows faster than 1 kHz are decimated, 0 for none.
    ``sensor_layout``: None for the default of the number of taxels.
    """

    name: str
    text: str
    sensor: str
    sensor_layout: SensorLayout | None
    labels: LabelRules
    trial_column: str
    elements: str
    variable: str
    delimiter: str
    decimal: str
    skip_lines: int
    header: bool | None
    missing: tuple[float, ...]
    transpose: bool
    taxels: tuple[str, ...]
    unit: str
    taxel_low: float
    taxel_high: float
    time_column: str
    time_s: float
    rate_hz: float
    loadcell: str
    loadcell_factor: float
    extra: tuple[str, ...]
    max_gap_s: float
    outlier_sigma: float
    finest_mm: float
    low_pass_hz: float

    @property
    def channels(self) -> tuple[str, ...]:
        """Every column that must hold numbers."""
        single = (self.time_column, self.loadcell)
        return (*self.taxels, *self.extra, *(column for column in single if column))

    @property
    def label_columns(self) -> tuple[str, ...]:
        """Every column or field that gives a label, or tells trials apart."""
        columns = (*self.labels.columns.values(), self.trial_column)
        return tuple(dict.fromkeys(column for column in columns if column))


def load_map(path: Path) -> ImportMap:
    """Load and validate a map. Raises ConfigError naming file, line and key."""
    return parse_map(TomlText.read(path, ConfigError), path.stem)


def parse_map(text: TomlText, default_name: str) -> ImportMap:
    """Return the validated map of a text. Raises ConfigError naming file, line and key."""
    root = text.root
    keys = ("files", "trials", "time", "taxels", "labels", "textures", "loadcell", "quality")
    tables = {key: root.table(key) for key in keys}
    files, trials, time, taxels = (tables[key] for key in keys[:4])
    loadcell, quality = tables["loadcell"], tables["quality"]
    name = root.text("name", default_name)
    sensor, sensor_layout = _read_sensor(root)
    root.allow("extra")
    extra = root.table("extra").texts("columns") if "extra" in root else ()
    root.finish()
    mapping = ImportMap(
        name=name,
        text=text.source,
        sensor=sensor,
        sensor_layout=sensor_layout,
        labels=read_label_rules(files, tables["labels"], tables["textures"]),
        trial_column=trials.text("column", ""),
        elements=trials.text("elements", ""),
        variable=files.text("variable", ""),
        delimiter=_read_delimiter(files),
        decimal=files.choice("decimal", DECIMALS, "."),
        skip_lines=files.integer("skip_lines", 0, low=0, high=MAX_SKIPPED),
        header=_read_header(files),
        missing=files.numbers("missing", low=-MAX_VALUE, high=MAX_VALUE),
        transpose=files.flag("transpose", False),
        taxels=taxels.texts("columns"),
        unit=taxels.text("unit", ""),
        taxel_low=taxels.number("low", 0.0, low=-MAX_VALUE, high=MAX_VALUE),
        taxel_high=taxels.number("high", 0.0, low=-MAX_VALUE, high=MAX_VALUE),
        time_column=time.text("column", ""),
        time_s=SECONDS[time.choice("unit", SECONDS, "s")],
        rate_hz=time.number("rate_hz", 0.0, unit="Hz", low=0, high=MAX_RATE_HZ),
        loadcell=loadcell.text("column", ""),
        loadcell_factor=read_unit(loadcell, "unit", GRAMS, "g", KPA, "area_mm2").factor,
        extra=extra,
        max_gap_s=quality.number("max_gap_s", 0.0, unit="s", low=0, high=1e6),
        outlier_sigma=quality.number("outlier_sigma", 12.0, low=3, high=1e6),
        finest_mm=quality.number("finest_mm", 1.0, unit="mm", low=1e-3, high=1e4),
        low_pass_hz=quality.number(
            "low_pass_hz", LOW_PASS_HZ, unit="Hz", low=0, high=LOW_PASS_MAX_HZ
        ),
    )
    for table in tables.values():
        table.finish()
    _check_choices(mapping, tables)
    return mapping


def _check_choices(mapping: ImportMap, tables: Mapping[str, TomlTable]) -> None:
    """Fail for keys of which one excludes the other."""
    if bool(mapping.time_column) == bool(mapping.rate_hz):
        reason = "give either a time column, or rate_hz of rows without gaps"
        tables["time"].fail("column", reason)
    if 0 < mapping.rate_hz < MIN_RATE_HZ:
        tables["time"].fail("rate_hz", f"is below {MIN_RATE_HZ:g} Hz")
    if mapping.taxel_low > mapping.taxel_high:
        tables["taxels"].fail("high", "is below low")
    if 0 < mapping.taxel_high - mapping.taxel_low < SMALLEST_SPAN:
        tables["taxels"].fail("high", f"is above low by less than {SMALLEST_SPAN:g}")
    if mapping.elements and mapping.variable:
        reason = "names begin below each element: leave out variable in [files]"
        tables["trials"].fail("elements", reason)


def _read_sensor(root: TomlTable) -> tuple[str, SensorLayout | None]:
    """Return name and layout of the sensor: a text is the name alone, a table may have both."""
    if root.is_text("sensor"):
        return root.text("sensor"), None
    sensor = root.table("sensor")
    name = sensor.text("name", "")
    rows = sensor.integer("rows", 0, low=1, high=MAX_TAXELS) if "rows" in sensor else 0
    columns = sensor.integer("columns", 0, low=1, high=MAX_TAXELS) if "columns" in sensor else 0
    sensor.allow("layers", "rows", "columns")
    layers = sensor.texts("layers") if "layers" in sensor else LAYER_NAMES[:1]
    sensor.finish()
    if not rows and not columns and "layers" not in sensor:
        return name, None
    if not rows or not columns:
        sensor.fail("", "needs rows and columns: those of one layer")
    try:
        return name, SensorLayout(rows, columns, layers)
    except ValueError as error:
        sensor.fail("", str(error))


def _read_header(table: TomlTable) -> bool | None:
    """Return whether the first row has names, None where its cells tell."""
    table.allow("header")
    return table.flag("header", False) if "header" in table else None


def _read_delimiter(table: TomlTable) -> str:
    delimiter = table.text("delimiter", "")
    if len(delimiter) > 1 or delimiter in ("\n", "\r", '"'):
        table.fail("delimiter", "must be one letter between two cells, such as ';'")
    return delimiter
