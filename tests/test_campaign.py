"""A part of the campaign against the store of results (`python -m tests.campaign`).

What it leaves out (a command or worker killed or terminated, two at once) has its own tests.
"""

import os
import shutil

from tests.campaign import all_killed, campaign, contents, edited, finish, start, starved

# Of one's own: another language, encoding, time zone, order of hashes; nobody's home.
ELSEWHERE = {
    "LC_ALL": "C", "LANG": "tr_TR", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0",
    "TZ": "Pacific/Kiritimati", "PYTHONHASHSEED": "7", "HOME": "/proc/nobody",
}  # fmt: skip
LATER = 2**32  # s, in the year 2106


def test_nothing_is_lost_whatever_is_killed_edited_or_full(undisturbed_work):
    kinds = (all_killed, edited, starved)
    tally = campaign(rounds=1, seed=1, kinds=kinds, done_before=undisturbed_work)
    tried = tally["tried"] if os.getuid() == 0 else tally["tried"].drop("starved")  # mounts a disk
    assert (tried == 1).all()
    assert not tally.drop(columns="tried").any(axis=None), f"\n{tally}"


def test_the_same_bytes_come_out_anywhere_and_a_clock_that_was_set_back_does_nothing(
    undisturbed_work, tmp_path
):
    plain, odd = tmp_path / "plain", tmp_path / "mit Leerzeichen, ü"
    odd.mkdir()
    (tmp_path / "link").symlink_to(odd)
    shutil.copytree(undisturbed_work[0], plain)
    code, said = finish(start(tmp_path / "link" / "ergebnis é", workers=1, **ELSEWHERE))
    assert code == 0, said
    first, second = contents(plain), contents(odd / "ergebnis é")
    assert len(first) > 20 and first == second, {n for n in first if first[n] != second.get(n)}
    provenance = [path.read_bytes() for path in sorted(plain.rglob("provenance.json"))]
    for path in plain.rglob("*"):
        os.utime(path, (LATER, LATER))
    code, said = finish(start(plain))
    assert code == 0 and contents(plain) == first, said
    again = [path.read_bytes() for path in sorted(plain.rglob("provenance.json"))]
    assert again == provenance, "trained anew"
