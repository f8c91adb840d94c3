"""Print what pip installs here, version by version, with hashes.

python .ci/lock.py > .ci/lock-linux-x86_64-py311.txt
"""

import json
import subprocess
import sys

COMMAND = ("install", "--dry-run", "--ignore-installed", "--quiet", "--report", "-")

report = subprocess.check_output(
    [sys.executable, "-m", "pip", *COMMAND, "-r", "requirements.txt"], text=True
)
print(f"# pip {' '.join(COMMAND)} -r requirements.txt; made by .ci/lock.py")
print("# pip install --require-hashes -r <this file> && pip install --no-deps -e .")
print("--extra-index-url https://download.pytorch.org/whl/cpu")
for package in sorted(json.loads(report)["install"], key=lambda p: p["metadata"]["name"].lower()):
    hashes = package["download_info"].get("archive_info", {}).get("hashes")
    if hashes:  # this library itself has none
        meta = package["metadata"]
        print(f"{meta['name']}=={meta['version']} --hash=sha256:{hashes['sha256']}")
