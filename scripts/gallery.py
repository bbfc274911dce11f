"""From a folder of logs to a page to look at: `python scripts/gallery.py LOGS report.html`."""

import sys

import jaxradar


def main(logs: str, page: str) -> None:
    for one in jaxradar.import_logs(logs, "store"):  # only what is new or changed is read
        print(one.done, one.entry.error or one.entry.source)
    found = jaxradar.evaluate("store", "default", pictures=True)
    table = found.to_arrow()  # or to_pandas(), to_polars(); one row for each sensor of each log
    print(table.select(["path", "detections", "hits", "misses", "false_alarms"]).to_string(preview_cols=5))
    jaxradar.write_report(found, page)
    print(page)


if __name__ == "__main__":  # the import starts processes, which read this file too
    main(*sys.argv[1:])
