"""``python -m aerodft``, and the ``aerodft`` script: signals are handled before anything else is loaded."""

from aerodft.cli.interrupts import INTERRUPTED, ending_on_signals, exit_process, stopped_code


def main() -> None:
    """Run the command line and end the process."""
    with ending_on_signals():
        try:
            from aerodft.cli.main import main as run

            run()
        except SystemExit as ending:
            exit_process(ending.code)
        except KeyboardInterrupt:  # before the command line was loaded
            exit_process(INTERRUPTED)
        except Exception:
            if (code := stopped_code()) is None:
                raise
            exit_process(code)


if __name__ == "__main__":
    main()
