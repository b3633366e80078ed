"""`python -m surfuse` is the command line."""

from surfuse.cli import main

if __name__ == "__main__":
    main()
