"""The command line: what each command takes, and how its errors end."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence

from .errors import InputError


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
    words = list(sys.argv[1:] if argv is None else argv)
    try:
        options = _parser().parse_args(words)
        return _run(options, shlex.join(["intervis", *words]))
    except InputError as error:
        print(f"intervis: {error}", file=sys.stderr)
        return 2
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
    render.add_argument("--threshold", type=float, metavar="E", help="stop a pixel at this relative error")
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

    commands.add_parser("scenes", help="list the built-in scenes")
    commands.add_parser("doctor", help="say what works here, and what to do about the rest")
    return parser


if __name__ == "__main__":
    sys.exit(main())
