"""One peer in a Python of its own: jobs come as lines of JSON, seconds go back. Imports nothing of this package.

Run by `heightfield_peers` as ``PYTHON heightfield_worker.py horayzon|topocalc``.
"""

import json
import os
import sys
import time

import numpy as np


class Horayzon:
    """Occlusion rays with a binary search in elevation (horayzon-extpar): degrees, azimuths from north."""

    def load(self, heights, spacing):
        """Build the mesh and its tree."""
        from horayzon_extpar import Terrain

        rows, columns = heights.shape
        y, x = np.mgrid[:rows, :columns].astype(np.float32)
        vertices = np.stack([x * spacing, -y * spacing, heights], axis=-1).reshape(-1, 3).astype(np.float32)
        # Counter-clockwise from above, cut from north-west to south-east
        nw = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
        sw, ne, se = nw + columns, nw + 1, nw + columns + 1
        faces = np.concatenate([np.stack([nw, sw, se], -1), np.stack([nw, se, ne], -1)]).astype(np.uint32)
        # A plane: the Earth's centre as far below as float32 bears
        centre, pole = np.array([0, 0, -6.4e9], np.float32), np.array([0, 6.4e9, 0], np.float32)
        self.columns, self.reach = columns, float(np.clip(1.5 * spacing * max(rows, columns), 1000, 800_000))
        self.terrain = Terrain()
        self.terrain.initialise(np.ascontiguousarray(vertices), np.ascontiguousarray(faces), centre, pole)

    def run(self, azimuths, strips, accuracy):
        """Return horizons of the points of some strips of rows, (points, azimuths)."""
        found = []
        for first, last in strips:
            which = np.array([first * self.columns, last * self.columns], np.uint32)
            found.append(self.terrain.horizon_vertex(azimuths, 0.0, which, self.reach, 5.0, accuracy, -80.0))
        return np.concatenate(found)


class Topocalc:
    """Horizons by Dozier and Frew's search along skewed rows: cosines from the zenith, 0° south, east positive."""

    def load(self, heights, spacing):
        """Keep the field."""
        self.heights, self.spacing = heights.astype(np.float64), spacing

    def run(self, azimuths):
        """Return cosines of all points, (azimuths, rows, columns)."""
        from topocalc.horizon import horizon

        return np.stack([horizon(a, self.heights, self.spacing) for a in azimuths])


def main():
    """Serve jobs until the input ends."""
    # The peers print: keep a way out of our own, and send theirs to stderr
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    peer = {"horayzon": Horayzon, "topocalc": Topocalc}[sys.argv[1]]()
    for line in sys.stdin:
        job = json.loads(line)
        try:
            if job["do"] == "load":
                peer.load(np.load(job["heights"]), job["spacing"])
                answer = {"seconds": 0.0}
            else:
                begin = time.perf_counter()
                values = peer.run(**job["with"])
                answer = {"seconds": time.perf_counter() - begin}
                if job.get("save"):
                    np.save(job["save"], values)
        except Exception as e:  # told to the benchmark, which goes on without this peer
            answer = {"error": f"{type(e).__name__}: {e}"}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
