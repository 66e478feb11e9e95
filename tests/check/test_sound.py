"""Audio that was copied, but for a stretch: the check names what is lost or changed, and where."""

import av
import pytest
from support import takes

from nlens_video.check.command import compare
from nlens_video.core.settings import SourceSettings

PACKET_S = 1024 / 48000


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plate")
    return takes.encode(folder / "in.mp4", [takes.plate(n) for n in range(takes.FRAMES)])


def rewritten(source, path, edit):
    """A file's packets as they are; `edit` gives those in place of each one of audio."""
    with av.open(str(source)) as given, av.open(str(path), "w") as out:
        streams = {one.index: out.add_stream_from_template(one) for one in given.streams}
        number = 0
        for packet in given.demux():
            if packet.dts is None:
                continue
            kept = [packet]
            if packet.stream.type == "audio":
                kept, number = edit(packet, number), number + 1
            for one in kept:
                one.stream = streams[packet.stream_index]
                out.mux(one)
    return path


def found(result, plate):
    return compare(str(result), SourceSettings(spec=str(plate))).verdict


def test_packets_lost_in_the_middle_are_named_as_a_hole(source, tmp_path):
    hole = range(12, 22)
    result = rewritten(source, tmp_path / "o.mkv", lambda packet, n: [] if n in hole else [packet])
    verdict = found(result, source)
    (finding,) = verdict.findings
    assert finding.kind == "sound" and "lacks 10 of the plate's packets from 0.2" in finding.text
    assert finding.value == 10.0 and verdict.notes[1:] == () and "sound" not in verdict.unknown


def test_packets_that_are_exchanged_are_named_as_others(source, tmp_path):
    def other(packet, number):
        if number not in range(5, 9):
            return [packet]
        made = av.Packet(bytes(packet)[::-1])
        made.pts, made.dts, made.time_base = packet.pts, packet.dts, packet.time_base
        made.duration = packet.duration
        return [made]

    (finding,) = found(rewritten(source, tmp_path / "o.mkv", other), source).findings
    assert "other packets than the plate from 0.09 to 0.17 s" in finding.text


def test_audio_copied_as_it_is_has_no_findings(source, tmp_path):
    verdict = found(rewritten(source, tmp_path / "o.mkv", lambda packet, n: [packet]), source)
    assert verdict.findings == () and "sound" not in verdict.unknown
