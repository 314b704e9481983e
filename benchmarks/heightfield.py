"""Height fields: horizons, local horizons and light against their peers, their baselines and brute force.

``python -m benchmarks.heightfield`` writes ``docs/heightfield/table.md``, ``table.csv`` and plots. The peers need Pythons of
their own: one with ``horayzon-extpar``, one with ``topocalc`` (see their pages for how to build them).
"""

from __future__ import annotations

import argparse
import os
import sys
import time
import traceback
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import mitsuba as mi

import intervis  # noqa: F401  finds an LLVM that works, before anything uses it

OUT = Path(__file__).resolve().parent.parent / "docs" / "heightfield"
PARTS = ("peers", "kernels", "growth", "accuracy", "memory", "light", "converge")

TEXT = """# Height fields, measured

{machine}; {threads} threads unless said otherwise. {repeats} repeats, warm, in turns with what they are compared to. Ratios
are those of median times, in brackets the least and the greatest within a round.{trial}

## Figures
{figures}
"""


def main(arguments: list[str] | None = None) -> None:
    """Run the benchmark, print the report and write it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.heightfield", description=__doc__)
    parser.add_argument("--parts", default=",".join(PARTS), help="comma-separated; default: all")
    parser.add_argument("--quick", action="store_true", help="small fields: a trial, not a measurement")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--horayzon-python", metavar="PATH", help="a Python that has horayzon-extpar")
    parser.add_argument("--topocalc-python", metavar="PATH", help="a Python that has topocalc")
    parser.add_argument("--output", type=Path, default=OUT)
    options = parser.parse_args(arguments)
    names = options.parts.split(",")
    if unknown := set(names) - set(PARTS):
        parser.error(f"--parts must be some of {', '.join(PARTS)} (got {', '.join(sorted(unknown))})")
    from . import heightfield_tables as tables

    # Interrupted, or with a part that fails, it reports the parts that are done
    start, parts = time.perf_counter(), []
    for name in (n for n in PARTS if n in names):
        try:
            # Each in a process of its own: none inherits another's memory, or its allocator's settings
            with ProcessPoolExecutor(1, get_context("spawn")) as pool:
                parts.append(pool.submit(_measure, name, options, time.perf_counter() - start).result())
        except KeyboardInterrupt:
            print("interrupted: reporting the parts that are done", file=sys.stderr)
            break
        except Exception as e:
            traceback.print_exc()
            parts.append(tables.Part(name, text=[f"This part failed: {type(e).__name__}: {e}"]))

    head = ["figure", "floor", "goal", "measured [spread]", "reached", "note"]
    text = TEXT.format(
        machine=tables.machine(),
        threads=options.threads,
        repeats=options.repeats,
        trial=" Small fields: a trial, no measurement." if options.quick else "",
        figures=tables.grid(head, [r.cells() for p in parts for r in p.rows]),
    )
    options.output.mkdir(parents=True, exist_ok=True)
    for part in parts:
        pictures = []
        for file, draw, data in part.plots:
            draw(options.output / file, data)
            pictures.append(f"![{Path(file).stem}]({file})")
        text += "\n" + "\n\n".join([f"## {part.title}", *part.text, *pictures]) + "\n"
    (options.output / "table.md").write_text(text)
    tables.write_csv(options.output / "table.csv", parts)
    print(text)


def _measure(name, options, before):
    mi.set_variant("llvm_ad_rgb")
    from . import heightfield_accuracy as accuracy
    from . import heightfield_kernels as kernels
    from . import heightfield_light as light
    from . import heightfield_peers as peers

    jobs = dict(zip(PARTS, (peers.measure, kernels.measure, kernels.growth, accuracy.measure, accuracy.memory,
                            light.measure, light.converge), strict=True))  # fmt: skip
    start = time.perf_counter() - before

    def note(text):
        print(f"{time.perf_counter() - start:6.0f} s  {text}", file=sys.stderr, flush=True)

    return jobs[name](options, note)


if __name__ == "__main__":
    main()
