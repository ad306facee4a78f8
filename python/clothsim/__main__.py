"""`python -m clothsim`: the command line of `clothsim.cli`."""

from clothsim.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
