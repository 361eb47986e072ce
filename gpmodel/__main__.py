"""The command line as `python -m gpmodel`, for where the script is not on the path."""

from gpmodel.cli.main import main

if __name__ == "__main__":
    main()
