"""Sessions in the formats of other programs: NWB, MATLAB, Parquet, CSV and Neo."""
