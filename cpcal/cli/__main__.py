"""`python -m cpcal.cli`."""

from cpcal.cli import main

if __name__ == "__main__":
    main()
