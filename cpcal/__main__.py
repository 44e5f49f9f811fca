"""`cpcal` and `python -m cpcal`: imports nothing before Ctrl-C is taken care of."""


def main() -> None:
    """Entry point of the command `cpcal`."""
    import sys

    try:
        from cpcal.cli.app import app

        app(prog_name="cpcal")
    except KeyboardInterrupt:
        sys.stderr.write("cpcal: interrupted\n")
        sys.exit(130)
    except Exception as error:
        what = f"{type(error).__name__}: {error}".splitlines()[0]
        sys.stderr.write(f"cpcal: internal error, please report it with the command and its files ({what})\n")
        sys.exit(3)
    finally:
        # After a Ctrl-C within an exec (of dataclasses, say) Python ends by SIGINT, whatever the status: a new exec
        # makes it forget.
        exec("")


if __name__ == "__main__":
    main()
