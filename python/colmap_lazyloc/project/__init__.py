"""From photos to the report: `lazyloc run`."""
