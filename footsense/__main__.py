"""`python -m footsense` is the command `footsense`."""

from footsense.cli import main

if __name__ == "__main__":
    main()
