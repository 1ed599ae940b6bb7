"""Reads results.jsonl of a run with pandas: how many queries have each status, and which poses are least certain.

python read_results.py localized/results.jsonl
"""

import sys

import pandas as pd

results = pd.read_json(sys.argv[1], lines=True).set_index("name")
print(results["status"].value_counts().to_string())
localized = results[results["status"] == "LOCALIZED"]
table = pd.DataFrame(
    {
        "confidence": localized["confidence"],
        "position_stddev": localized["position_stddevs"].str[0],
        "rotation_stddev_deg": localized["rotation_stddev_deg"],
        "error_px": localized["mean_reprojection_error_px"],
    }
)
print(table.sort_values("position_stddev", ascending=False).head(10).to_string())
