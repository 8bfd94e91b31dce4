"""Run pip as if on another system: `python foreign_pip_command.py MARKERS download ...`.

pip's `--platform` chooses the files of another system, but the conditions in packages' requirements (`colorama;
platform_system == "Windows"`) it answers for the system that it runs on. MARKERS is the JSON of what that system would
answer.
"""

import json
import sys


def main() -> int:
    """Run pip with the other system's answers; return its exit code."""
    from pip._internal.cli.main import main as pip
    from pip._vendor.packaging import markers

    answers = json.loads(sys.argv[1])
    own = markers.default_environment()
    if unknown := answers.keys() - own.keys():
        sys.stderr.write(f"pip knows no {', '.join(sorted(unknown))} in conditions; another version of pip is needed\n")
        return 1
    markers.default_environment = lambda: own | answers
    if not markers.Marker(f"platform_system == '{answers['platform_system']}'").evaluate():
        sys.stderr.write("pip does not take the other system's answers; another version of pip is needed\n")
        return 1
    return pip(sys.argv[2:])


if __name__ == "__main__":
    sys.exit(main())
