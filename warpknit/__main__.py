"""`python -m warpknit`: the same program as `warpknit`."""

from warpknit.commands.cli import main

if __name__ == "__main__":
    main(prog_name="warpknit")
