import json
from html.parser import HTMLParser

from hypothesis import given
from hypothesis import strategies as st

from surfuse.report.markup import Markup, element, join, script_json


class Reader(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.text = [], ""

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text += data


def read(markup):
    reader = Reader()
    reader.feed(str(markup))
    reader.close()
    return reader


PRINTABLE = st.text(st.characters(exclude_categories=["Cc", "Cs"]), max_size=60)


@given(PRINTABLE, PRINTABLE)
def test_any_text_comes_back_as_text_and_nothing_else(text, value):
    reader = read(element("p", {"title": value}, text))
    assert reader.tags == [("p", {"title": value})]
    assert reader.text == text


def test_markup_is_kept_and_text_beside_it_is_escaped():
    inner = element("b", None, "a<b")
    assert str(element("p", None, inner, "<i>")) == "<p><b>a&lt;b</b>&lt;i&gt;</p>"
    assert str(join([Markup("<hr>"), "&"], " ")) == "<hr> &amp;"


def test_true_attributes_stand_alone_and_false_ones_vanish():
    assert str(element("input", {"checked": True, "disabled": False, "value": 0.5})) == '<input checked value="0.5">'


@given(
    st.recursive(
        st.none() | st.booleans() | PRINTABLE, lambda inner: st.lists(inner) | st.dictionaries(PRINTABLE, inner)
    )
)
def test_json_in_a_script_reads_back_and_cannot_end_the_script(value):
    text = script_json(value)
    assert json.loads(text) == value
    assert not set("<>&\u2028\u2029") & set(text)
