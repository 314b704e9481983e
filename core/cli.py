"""The command line: what each command takes, and how its errors end."""

from __future__ import annotations

import argparse
import os
import re
import shlex
import signal
import sys
from collections.abc import Sequence

from .errors import STOPS, InputError


class _Parser(argparse.ArgumentParser):
    """A parser whose complaints are one sentence, as all other wrong inputs'."""

    def error(self, message: str) -> None:
        raise InputError(f"{message} (see `{self.prog} --help`)")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments without the program's name; those of the process by default.

    Returns
    -------
    int
        Exit code: 0 done, 1 a comparison above its limit or nothing that can render, 2 a wrong input,
        130 interrupted.
    """
    if argv is None:
        # However a run is ended, it ends like one that Ctrl-C ends: no half-written files
        for which in STOPS:
            if signal.getsignal(which) == signal.SIG_DFL:
                signal.signal(which, signal.default_int_handler)
    words = list(sys.argv[1:] if argv is None else argv)
    # A number below zero is no option, however it is written: --sun -135,30,900 or --nodata -3.4e38
    for at in range(len(words) - 1, 0, -1):
        if re.match(r"--[^=]+$", words[at - 1]) and re.match(r"-\.?\d", words[at]):
            words[at - 1 : at + 1] = [f"{words[at - 1]}={words[at]}"]
    try:
        options = _parser().parse_args(words)
        code = _run(options, shlex.join(["intervis", *words]))
        sys.stdout.flush()
        return code
    except InputError as error:
        print(f"intervis: {error}", file=sys.stderr)
        return 2
    except MemoryError as error:
        print(f"intervis: not enough memory: {error or 'ask for less at once'}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        # Whoever read the report has left, as `head` does; files are written by then, and nothing more is to be said
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        print("intervis: interrupted", file=sys.stderr)
        return 130


def _run(options: argparse.Namespace, command: str) -> int:
    """Run the chosen command; modules are imported here, so that ``--help`` and mistakes answer at once."""
    if options.command == "render":
        from . import render

        return render.command(options, command)
    if options.command == "compare":
        from . import compare

        return compare.command(options)
    if options.command == "doctor":
        from . import doctor

        return doctor.command()

    if options.command == "heightfield":
        from .heightfield import command as heightfield

        return heightfield.run(options, command)

    from . import scenes

    for name in scenes.names():
        print(f"{name:<12}{scenes.describe(name)}")
    return 0


def _parser() -> _Parser:
    """Return the parser of all commands."""
    from . import __version__

    parser = _Parser(prog="intervis", description="Visibility-first rendering for Mitsuba 3.")
    parser.add_argument("--version", action="version", version=f"intervis {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    render = commands.add_parser(
        "render",
        help="render a Mitsuba XML file or a built-in scene to an OpenEXR",
        description="Render a Mitsuba XML file or a built-in scene to an OpenEXR, and print the report.",
    )
    render.add_argument("scene", metavar="SCENE", help="a Mitsuba XML file, or a name from `intervis scenes`")
    render.add_argument("-o", "--output", metavar="OUT.exr", help="file to write (default: SCENE.exr, here)")
    render.add_argument("--integrator", default="visdirect", metavar="NAME", help="default: %(default)s")
    render.add_argument("--spp", type=int, metavar="N", help="samples a pixel (default: the scene's)")
    render.add_argument("--seed", type=int, default=0, metavar="S", help="default: %(default)s")
    render.add_argument("--variant", default="llvm_ad_rgb", metavar="V", help="default: %(default)s")
    render.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="settings",
        help="a parameter of the integrator, or with scene.KEY=VALUE of the scene; may be repeated",
    )
    render.add_argument("--aovs", action="store_true", help="add the layers of visibility, rays and error")
    render.add_argument("--threshold", type=float, metavar="E", help="stop at this relative error of the image")
    render.add_argument("--png", action="store_true", help="also write sRGB PNGs of picture and maps")

    compare = commands.add_parser(
        "compare",
        help="compare two OpenEXR images",
        description="Print the difference of A from the reference B; exit with 1 if it is above the limit.",
    )
    compare.add_argument("image", metavar="A.exr")
    compare.add_argument("reference", metavar="B.exr")
    compare.add_argument(
        "--metric",
        choices=["relmse", "mse", "mae", "psnr", "flip"],
        default="relmse",
        help="default: %(default)s",
    )
    compare.add_argument("--fail-above", type=float, metavar="X", help="exit with 1 above this difference")
    compare.add_argument("-o", "--output", metavar="DIFF.png", help="write a picture of the difference")

    _heightfield(commands)
    commands.add_parser("scenes", help="list the built-in scenes")
    commands.add_parser("doctor", help="say what works here, and what to do about the rest")
    return parser


def _heightfield(commands) -> None:
    # Names are spelled out here: importing the module would cost every command a second
    fields, default = "fractal, brick, sine, blocks, random, bowl, groove", "default: %(default)s"
    products = "irradiance, skyview, horizons, shadow"
    p = commands.add_parser(
        "heightfield",
        help="horizons, sky view, shadow and irradiance of a height map",
        description="Light a height map (.tif .npz .npy .exr .png, or a built-in field) and write the products. "
        "Angles are in degrees, clockwise from north.",
    )
    p.add_argument("dem", metavar="DEM", help=f"a file, 'jacksboro' (real terrain), or {fields}")
    p.add_argument(
        "-o", "--output", metavar="OUT", help=".exr, .tif or .npz (default: DEM.exr, here; DEM.light.tif from a GeoTIFF)"
    )
    p.add_argument("--products", default="irradiance", metavar="A,B", help=f"of {products} ({default})")
    p.add_argument("--azimuths", type=int, default=64, metavar="K", help="directions (default: %(default)s)")
    p.add_argument("--sun", metavar="AZ,EL,W", help="azimuth, elevation, W/m² facing the sun")
    p.add_argument("--sky", default="1", metavar="W|FILE.exr", help="radiance, W/(m² sr), or an environment map, up first")
    p.add_argument("--albedo", type=float, default=0.3, metavar="A", help="default: %(default)s")
    p.add_argument("--bounces", type=int, default=2, metavar="B", help="default: %(default)s")
    p.add_argument(
        "--supersampling",
        type=int,
        default=1,
        metavar="S",
        help=f"cells a cell is cut into, a side, as it sends light ({default})",
    )
    p.add_argument("--preview", metavar="OUT.png", help="write a picture too")
    p.add_argument("--spacing", metavar="M|DY,DX", help="metres between samples (default: the file's, or 1)")
    p.add_argument("--size", type=int, default=256, metavar="N", help=f"samples a side of a built-in field ({default})")
    p.add_argument("--nodata", type=float, metavar="H", help="a height that means unknown (default: the file's)")
    p.add_argument("--nodata-policy", default="fill", metavar="P", help="fill, transparent or block (default: %(default)s)")
    p.add_argument("--curvature", action="store_true", help="let the Earth curve away, with refraction")
    p.add_argument("--radius", type=float, metavar="M", help="look no farther than so many metres")
    p.add_argument("--tile", type=int, metavar="N", help="hold so many points a side at a time, and those within the radius")


if __name__ == "__main__":
    sys.exit(main())
