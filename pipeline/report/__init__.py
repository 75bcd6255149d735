"""The page of a recording, from Parquet alone."""
