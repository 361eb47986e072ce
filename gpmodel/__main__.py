"""Run the command line by `python -m gpmodel`, also if the script `gpmodel` is not on the path."""

from gpmodel.cli.main import main

if __name__ == "__main__":
    main()
