"""`python -m trials.cli`."""

from trials.cli.main import main

if __name__ == "__main__":
    main()
