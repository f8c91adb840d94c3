"""A live stream: real LSL streams on the loopback address, where mne-lsl is installed."""

import os
import signal
import subprocess
import sys
import threading
import time
from itertools import count

import mne
import numpy as np
import pytest

from rlihf_lib.__main__ import main
from rlihf_lib.eeg.decoder import Decoder
from rlihf_lib.eeg.eegnet import half_second_architecture
from rlihf_lib.eeg.ensemble import EEGNetBatch
from rlihf_lib.eeg.folders import find
from rlihf_lib.eeg.formats import named_events, open_recording
from rlihf_lib.eeg.signals import InputFormat
from rlihf_lib.eeg.streaming import CausalFilter
from tests.eeg.amplifier import CONFIG, Amplifier

lsl = pytest.importorskip("rlihf_lib.eeg.lsl")
PlayerLSL = pytest.importorskip("mne_lsl.player").PlayerLSL
CHANNELS, RATE = ("Fz", "Cz", "Pz"), 256.0
ONSETS = np.array([1600, 1750, 1799, 2000])  # samples
numbers = count()


def make_decoder(band=(1.0, 20.0)):
    layout = InputFormat(CHANNELS, RATE, 0.0, 512, start=0, stop=256, decimation=8)
    networks = EEGNetBatch(half_second_architecture(3, 32, layout.network_sfreq), [0, 1])
    return Decoder(layout, networks, temperature=1.5, prior=0.3, band=band)


@pytest.fixture
def names():
    number = next(numbers)
    return f"eeg-{number}", f"markers-{number}", f"out-{number}"


def noise(n, seed=0):
    return np.random.default_rng(seed).normal(0, 1e-5, (3, n))


def offline(decoder, recording, onsets):
    filtered = CausalFilter(decoder.band, RATE)(recording) if decoder.band else recording
    windows = (filtered[:, first : first + 256] for first in onsets)
    return [decoder.log_odds(window[None])[0] for window in windows]


def answers_of(live, n, seconds=5.0):
    """Poll until n events are answered."""
    answers, until = [], time.time() + seconds
    while len(answers) < n and time.time() < until:
        answers += live.poll()
    return answers


@pytest.fixture(scope="module")
def played():
    """A recording that mne-lsl's player plays, and what was decoded by triggers and by markers."""
    eeg = np.hstack([np.zeros((3, 1500)), noise(1000)])  # silent until everybody listens
    codes = np.zeros(2500)
    for onset, code in zip(ONSETS, (4, 5, 4, 4), strict=True):
        codes[onset : onset + 5] = code
    codes[1900:1905] = 9  # something else
    info = mne.create_info([*CHANNELS, "TRIGGER"], RATE, ["eeg"] * 3 + ["stim"])
    raw = mne.io.RawArray(np.vstack([eeg, codes]), info, verbose="error")
    times, words = np.append(ONSETS, 1900) / RATE, ["FB1", "FB2", "FB1", "FB1", "S  9"]
    raw.set_annotations(mne.Annotations(times, 0, words))
    player = PlayerLSL(raw, chunk_size=8, name="player", annotations_encoding="string")
    decoder = make_decoder()
    with player:
        by_trigger = lsl.LiveDecoder(decoder, "player", "45", trigger="TRIGGER", out="t")
        words = {"events": ["FB1", "FB2"], "markers": "player-annotations"}
        by_markers = lsl.LiveDecoder(decoder, "player", **words, out="m")
        corrected = lsl.LiveDecoder(decoder, "player", **words, delay=1 / RATE, out="c")
        answers, until = ([], [], []), time.time() + 12
        while min(map(len, answers)) < 4 and time.time() < until:
            for found, live in zip(answers, (by_trigger, by_markers, corrected), strict=True):
                found.extend(live.poll(0.005))
    return eeg, decoder, answers


def test_by_a_trigger_channel_live_equals_offline_bit_for_bit(played):
    eeg, decoder, (by_trigger, *_) = played
    assert [answer.flaw for answer in by_trigger] == [""] * 4
    live = [answer.log_odds for answer in by_trigger]
    np.testing.assert_array_equal(live, offline(decoder, eeg, ONSETS))


def test_by_the_players_time_stamps_live_is_one_sample_early_until_corrected(played):
    """mne-lsl stamps an annotation with the sample before it; `delay` makes up for it."""
    eeg, decoder, (_, *by_markers) = played
    for answers, onsets in zip(by_markers, (ONSETS - 1, ONSETS), strict=True):
        live = [answer.log_odds for answer in answers]
        np.testing.assert_array_equal(live, offline(decoder, eeg, onsets))


def test_p_error_comes_soon_after_the_window(played):
    for answers in played[2]:
        latencies = [answer.latency for answer in answers]
        # 1.05 s on a quiet machine; tests run beside each other.
        assert 0.95 < min(latencies) and np.median(latencies) < 1.1, latencies


def test_a_trigger_that_holds_its_value_gives_the_events_of_the_recording(names, tmp_path):
    codes = np.repeat([6, 4, 6, 0, 4, 9, 6], [100, 1, 99, 50, 50, 50, 350])
    recording, types = np.vstack([noise(700), codes]), ["eeg"] * 3 + ["stim"]
    info = mne.create_info([*CHANNELS, "TRIG"], RATE, types)
    file = tmp_path / "sub-01_raw.fif"
    mne.io.RawArray(recording, info, verbose="error").save(file, verbose="error")
    (held,), _ = find(tmp_path)
    told = named_events(open_recording(held), held).query("name in ['4', '6']")
    amplifier = Amplifier(names[0], [*CHANNELS, "TRIG"], RATE)
    live = lsl.LiveDecoder(make_decoder(), names[0], ["4", "6"], trigger="TRIG", out=names[2])
    amplifier.send(recording)
    stamps = [answer.stamp for answer in answers_of(live, 4)]
    expected = [amplifier.stamp(RATE * onset) for onset in told["onset"]]
    assert len(expected) == 4 and stamps == pytest.approx(expected, abs=1e-3)


def test_markers_belong_to_the_nearest_sample_and_p_error_to_its_marker(names):
    decoder, (eeg, markers, out) = make_decoder(), names
    amplifier = Amplifier(eeg, ["EOG", *CHANNELS[::-1]], RATE)
    outlet = lsl.StreamOutlet(lsl.StreamInfo(markers, "Markers", 1, 0, "string", markers))
    live = lsl.LiveDecoder(decoder, eeg, ["go"], markers=markers, delay=0.05, out=out)
    consumer, _ = lsl.connect(out)
    recording = noise(1000)
    marked = [amplifier.stamp(sample + off) - 0.05 for sample, off in ((100, 0.4), (400, -0.4))]
    outlet.push_sample(["go"], marked[0])  # before its samples ...
    outlet.push_sample(["stop"], marked[0])
    for first in range(0, 1000, 50):
        amplifier.send(np.vstack([np.ones((1, 50)), recording[::-1, first : first + 50]]))
        if first == 500:
            outlet.push_sample(["go"], marked[1])  # ... and after them
    answers = answers_of(live, 2)
    expected = offline(decoder, recording, (100, 400))
    np.testing.assert_array_equal([answer.log_odds for answer in answers], expected)
    np.testing.assert_allclose([answer.stamp for answer in answers], marked, atol=1e-3)
    for answer in answers:
        (p_error, log_odds), stamp = consumer.pull_sample(2)
        assert (p_error, log_odds) == (answer.p_error, answer.log_odds)
        assert stamp == pytest.approx(answer.stamp, abs=1e-3)


@pytest.mark.parametrize("band", [None, (1.0, 20.0)])
def test_lost_samples_are_noticed_said_and_not_decoded(names, band):
    decoder, (eeg, _, out), said = make_decoder(band), names, []
    amplifier = Amplifier(eeg, [*CHANNELS, "TRIG"], RATE)
    live = lsl.LiveDecoder(decoder, eeg, ["7"], trigger="TRIG", out=out, say=said.append)
    recording = np.vstack([noise(2000), np.zeros(2000)])
    recording[3, [100, 600, 1500]] = 7
    for first in range(0, 2000, 20):
        if first == 700:
            amplifier.skip(20)  # within the window of the second
        else:
            amplifier.send(recording[:, first : first + 20])
    answers = answers_of(live, 3)
    assert [answer.flaw for answer in answers] == ["", "samples were lost", ""]
    assert answers[1].p_error == pytest.approx(0.3) and np.isnan(answers[1].log_odds)
    assert said == ["20 samples lost (78 ms)"]
    before, after = offline(decoder, recording[:3], (100, 1500))
    assert answers[0].log_odds == pytest.approx(before, rel=1e-9)
    assert answers[2].log_odds == pytest.approx(after, abs=1e-3)


def test_a_marker_that_comes_too_late_gets_the_prior(names):
    eeg, markers, out = names
    amplifier = Amplifier(eeg, CHANNELS, RATE)
    outlet = lsl.StreamOutlet(lsl.StreamInfo(markers, "Markers", 1, 0, "string", markers))
    live = lsl.LiveDecoder(make_decoder(), eeg, ["go"], markers=markers, out=out)
    amplifier.send(noise(3000))
    while live.stream.buffer.n_received < 3000:
        live.poll()
    outlet.push_sample(["go"], amplifier.stamp(100))
    (answer,) = answers_of(live, 1)
    assert "reaches back to 1976 only" in answer.flaw and answer.p_error == pytest.approx(0.3)


def test_an_amplifier_that_falls_silent_is_said_once(names, monkeypatch):
    monkeypatch.setattr(lsl, "SILENCE", 0.1)
    said = []
    amplifier = Amplifier(names[0], [*CHANNELS, "TRIG"], RATE)
    told = {"trigger": "TRIG", "out": names[2], "say": said.append}
    live = lsl.LiveDecoder(make_decoder(), names[0], ["1"], **told)
    amplifier.send(np.ones((4, 20)))
    for _ in range(30):
        live.poll()
    assert said == [f"no sample from '{names[0]}' for 0.1 s; is the amplifier on?"]


@pytest.mark.parametrize(("unit", "factor"), [("microvolts", 1e6), ("-3", 1e3), ("", 1e6)])
def test_units_become_volts(names, unit, factor):
    decoder, said = make_decoder(), []
    amplifier = Amplifier(names[0], [*CHANNELS, "TRIG"], RATE, unit)
    told = {"trigger": "TRIG", "out": names[2], "say": said.append}
    live = lsl.LiveDecoder(decoder, names[0], ["1"], **told)
    recording = noise(400)
    amplifier.send(np.vstack([factor * recording, np.arange(400) > 99]))
    (answer,) = answers_of(live, 1)
    assert answer.log_odds == pytest.approx(offline(decoder, recording, (100,))[0], abs=1e-4)
    assert said == ([] if unit else ["the stream doesn't tell its units; taken for microvolts"])


def test_channels_that_are_not_decoded_may_be_named_alike(names):
    decoder = make_decoder()
    amplifier = Amplifier(names[0], ["AUX", *CHANNELS, "AUX", "TRIG"], RATE, "microvolts")
    live = lsl.LiveDecoder(decoder, names[0], ["1"], trigger="TRIG", out=names[2])
    recording, aux = noise(400), np.ones((1, 400))
    amplifier.send(np.vstack([aux, 1e6 * recording, aux, np.arange(400) > 99]))
    (answer,) = answers_of(live, 1)
    assert answer.log_odds == pytest.approx(offline(decoder, recording, (100,))[0], abs=1e-4)


@pytest.mark.parametrize(
    ("stream", "message"),
    [
        ({"channels": ("Fz", "Cz", "TRIG")}, r"lacks the channel\(s\) Pz .* it has Fz, Cz, TRIG"),
        ({"channels": ("", "", "", "")}, r"lacks the channel\(s\) Fz, Cz, Pz .* it has no names"),
        ({"channels": (*CHANNELS, "Cz")}, r"lacks the channel\(s\) Cz .* or has them twice"),
        ({"channels": (*CHANNELS, "TRIG", "TRIG")}, "they are numbers, and .* Pz, TRIG, TRIG"),
        ({"sfreq": 512.0}, "has 512 Hz, the decoder 256 Hz; set the amplifier"),
        ({"unit": "kelvin"}, "channels are in kelvin; let the amplifier's software tell volts"),
        ({"channels": CHANNELS}, r"events 1 of the channel 'TRIG': .* the channels Fz, Cz, Pz"),
    ],
)
def test_a_stream_that_does_not_fit_is_refused(names, stream, message):
    layout = {"channels": (*CHANNELS, "TRIG"), "sfreq": RATE} | stream
    amplifier = Amplifier(names[0], **layout)
    with pytest.raises(ValueError, match=message):
        lsl.LiveDecoder(make_decoder(), names[0], ["1"], trigger="TRIG")
    assert amplifier.n_sent == 0


def test_markers_that_are_no_words_are_refused(names):
    amplifier = Amplifier(names[0], CHANNELS, RATE)
    with pytest.raises(ValueError, match=f"'{names[0]}' has no words; markers are strings"):
        lsl.LiveDecoder(make_decoder(), names[0], ["go"], markers=names[0])
    assert amplifier.n_sent == 0


def test_a_stream_that_is_not_there_is_refused_and_those_that_are_are_named(names, monkeypatch):
    monkeypatch.setattr(lsl, "WAIT", 0.3)
    amplifier = Amplifier(names[0], CHANNELS, RATE)
    with pytest.raises(ValueError, match=rf"no LSL stream 'cap' within 0.3 s; .*{names[0]}"):
        lsl.LiveDecoder(make_decoder(), "cap", ["1"], trigger="TRIG")
    assert amplifier.n_sent == 0


def test_the_command_answers_until_ctrl_c(names, tmp_path):
    make_decoder().save(tmp_path / "live.safetensors")
    (tmp_path / "lsl.cfg").write_text(CONFIG)
    amplifier = Amplifier(names[0], [*CHANNELS, "TRIG"], RATE)
    options = ["--stream", names[0], "--trigger", "TRIG", "--events", "1", "--out", names[2]]
    command = [sys.executable, "-m", "rlihf_lib", "live", *options]
    environment = os.environ | {"LSLAPICFG": str(tmp_path / "lsl.cfg")}
    with subprocess.Popen(
        [*command, "--decoder", str(tmp_path / "live.safetensors")], env=environment,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        deadline = threading.Timer(120, process.kill)
        deadline.start()
        lines = iter(process.stdout.readline, "")
        heard = next(line for line in lines if "listening" in line)
        assert f"'{names[0]}'; p(error) of 1 comes 1.00 s after it, as '{names[2]}'" in heard
        amplifier.wait()
        amplifier.send(np.vstack([noise(400), np.arange(400) > 99]))
        assert next(lines).startswith("p(error) 0.")
        process.send_signal(signal.SIGINT)
        rest, problems = process.communicate()
        deadline.cancel()
    assert process.returncode == 0 and "1 events answered" in rest
    assert "Traceback" not in problems


def test_a_decoder_of_epochs_that_no_live_stream_can_be_is_refused(tmp_path, capsys):
    make_decoder(band=None).save(tmp_path / "offline.safetensors")
    options = ["live", "--stream", "cap", "--trigger", "TRIG", "--events", "1"]
    assert main([*options, "--decoder", str(tmp_path / "offline.safetensors")]) == 1
    assert "filtered forward and backward, which no live stream can be" in capsys.readouterr().err
    assert main([*options, "--decoder", str(tmp_path / "none.safetensors")]) == 1
    assert "none.safetensors" in capsys.readouterr().err
