import re
import xml.etree.ElementTree as ElementTree

import pytest

from pulsewright.boards.rapcores.registers import MAP
from pulsewright.errors import UsageError
from pulsewright.registers import rdl
from pulsewright.registers.generate import CHECKOUT, products
from pulsewright.registers.model import Field, Register
from pulsewright.registers.picture import boxes, describe, svg
from pulsewright.registers.render import html, json, markdown

SVG = "{http://www.w3.org/2000/svg}"

# The words of the document, as its bit fields have them: widths and names from bit 0 up.
DOCUMENT = {
    "W_ENABLE": [(32, "enable")],
    "W_BRAKE": [(32, "brake")],
    "W_DIVIDER": [(8, "divider")],
    "R_VERSION": [(8, "patch"), (8, "minor"), (8, "major"), (8, "devel")],
    "R_CHANNEL_INFO": [
        *((8, "motors"), (8, "encoders"), (8, "position_bits"), (8, "velocity_bits")),
    ],
    "R_ENCODER_FAULT": [(32, "fault")],
    "R_MOTOR_FAULT": [(32, "fault")],
    "R_ENCODER_POSITION": [(32, "position")],
}


def drawn(register):
    """Return the boxes of a picture, as (x, y, width, colour), and its texts with their places."""
    root = ElementTree.fromstring(svg(register))
    rects = [
        (int(r.get("x")), int(r.get("y")), int(r.get("width")), r.get("fill"))
        for r in root.iter(f"{SVG}rect")
        if r.get("x")
    ]
    texts = [(int(t.get("x")), int(t.get("y")), t.text) for t in root.iter(f"{SVG}text")]
    return root, rects, texts


def register(*fields, size=4):
    made = tuple(Field(name, lsb, width, 0) for name, lsb, width in fields)
    return Register("board", "NAME", "write", (0,), size, "Title", made, address_bytes=size)


@pytest.mark.parametrize("key", DOCUMENT)
def test_pictures_show_the_fields_of_the_document(key):
    _, rects, texts = drawn(MAP[key])
    expected = [*reversed(DOCUMENT[key])]
    unused = 32 - sum(width for width, _ in expected)
    widths = ([unused] if unused else []) + [width for width, _ in expected]
    assert [width for _, _, width, _ in rects] == [24 * width for width in widths]
    names = {name for _, name in expected}
    assert [text for _, _, text in texts if text in names] == [name for _, name in expected]


def test_boxes_fill_the_row_and_numbers_stand_at_their_ends():
    _, rects, texts = drawn(register(("b", 20, 4), ("a", 0, 1)))
    lefts = [x for x, _, _, _ in rects]
    assert lefts == [10, 10 + 24 * 8, 10 + 24 * 12, 10 + 24 * 31]
    assert rects[-1][0] + rects[-1][2] == 10 + 24 * 32
    colours = [colour for *_, colour in rects]
    assert colours[0] == colours[2] != colours[1] == colours[3]
    # bit n is centred (31 - n) bits from the left
    numbers = {int(text): x for x, _, text in texts if text.isdecimal()}
    assert numbers == {bit: 10 + 24 * (31 - bit) + 12 for bit in (31, 24, 23, 20, 19, 1, 0)}


def test_a_name_that_does_not_fit_is_written_downwards_in_a_taller_picture():
    root, _, _ = drawn(register(("executing", 16, 1)))
    turned = [t for t in root.iter(f"{SVG}text") if t.get("transform")]
    assert [t.text for t in turned] == ["executing"]
    plain, _, _ = drawn(register(("executing", 16, 8)))
    assert not [t for t in plain.iter(f"{SVG}text") if t.get("transform")]
    assert int(root.get("height")) > int(plain.get("height")) + 8 * 7


def test_words_of_64_bits_have_two_rows():
    _, rects, texts = drawn(register(("high", 32, 32), ("low", 0, 32), size=8))
    assert [x for x, *_ in rects] == [10, 10]
    assert rects[0][1] < rects[1][1]
    assert [text for _, _, text in texts] == ["63", "32", "high", "31", "0", "low"]
    wide = register(("all", 0, 64), size=8)
    assert [box[:2] for box in boxes(wide, 63, 32)] == [(63, 32)]


def test_owners_of_bits_are_named():
    _, _, texts = drawn(MAP["R_ENCODER_FAULT_HI"])
    assert "encoder 32..63" in [text for _, _, text in texts]


def test_pictures_are_described_in_words():
    text = "31:24 devel, 23:16 major, 15:8 minor, 7:0 patch"
    assert describe(MAP["R_VERSION"]) == text
    root, _, _ = drawn(MAP["R_VERSION"])
    assert root.find(f"{SVG}title").text == text


def test_a_page_shows_the_picture_of_every_register_and_word():
    page = markdown(MAP)
    shown = re.findall(r"!\[.+?\]\((rapcores/\w+\.svg)\)", page)
    assert len(shown) == len(set(shown)) == len(MAP.registers) + len(MAP.words)
    folder = CHECKOUT / "docs/registers"
    assert {path.name for path in (folder / "rapcores").iterdir()} == {
        name.split("/")[1] for name in shown
    }
    assert (folder / "rapcores/r_version.svg").read_text() == svg(MAP["R_VERSION"])


def test_pictures_are_products_of_the_source():
    source = CHECKOUT / "src/pulsewright/boards/rapcores/registers.rdl"
    made = products(source)
    path = CHECKOUT / "docs/registers/rapcores/word_move.svg"
    assert made[path] == svg(next(part for part in MAP.words if part.name == "MOVE"))
    assert made == products(source)
    assert not any(
        path.suffix == ".svg" for path in products(source.parents[1] / "usc/registers.rdl")
    )


def test_words_of_messages_are_read_and_shown():
    by_key = {part.key: part for part in MAP.words}
    assert {key: part.size for key, part in by_key.items()} == dict.fromkeys(by_key, 8)
    move = by_key["WORD_MOVE"]
    assert [(f.name, f.msb, f.lsb) for f in move.fields] == [
        ("header", 63, 56),
        ("direction", 31, 0),
    ]
    increment = by_key["WORD_INCREMENT"].fields[0]
    assert (increment.signed, increment.fracwidth, increment.unit) == (True, 63, "step/tick")
    for page in (markdown(MAP), html(MAP), json(MAP)):
        assert "Increment-increment of a motor" in page


def test_words_that_are_written_are_refused(tmp_path):
    path = tmp_path / "rapcores/registers.rdl"
    path.parent.mkdir()
    text = (CHECKOUT / "src/pulsewright/boards/rapcores/registers.rdl").read_text()
    right = 'field { desc = "0 ends at once."; unit = "tick"; } duration[31:0];'
    assert right in text
    wrong = 'field { sw = rw; desc = "0 ends at once."; unit = "tick"; } duration[31:0] = 0;'
    path.write_text(text.replace(right, wrong))
    with pytest.raises(UsageError, match=r"duration: is in addrmap 'words'; set sw = r"):
        rdl.read(path)
