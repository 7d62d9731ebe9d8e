//! A strict little reader of XML (tags, attributes, entities), and of base64, as oracles for what the crate writes.

/// One element: its name, its attributes, and the text directly inside it.
#[derive(Debug, Default, Clone)]
pub struct Element {
    pub name: String,
    pub attributes: Vec<(String, String)>,
    pub text: String,
}

impl Element {
    pub fn get(&self, name: &str) -> &str {
        self.attributes.iter().find(|a| a.0 == name).map_or("", |a| &a.1)
    }
}

/// Elements in the order in which they open; panics where tags do not balance or a character stands unescaped.
pub fn read(xml: &str) -> Vec<Element> {
    let (mut all, mut open): (Vec<Element>, Vec<usize>) = (Vec::new(), Vec::new());
    let mut rest = xml;
    while let Some(at) = rest.find('<') {
        let text = decode_entities(&rest[..at]);
        if let Some(&inside) = open.last() {
            all[inside].text.push_str(&text);
        } else {
            assert!(text.trim().is_empty(), "text {text:?} stands outside every element");
        }
        let end = at + rest[at..].find('>').expect("a tag that is not closed");
        let tag = &rest[at + 1..end];
        assert!(!tag.contains('<'), "`<` inside the tag {tag:?}");
        if let Some(name) = tag.strip_prefix('/') {
            let last = open.pop().unwrap_or_else(|| panic!("</{name}> closes nothing"));
            assert_eq!(all[last].name, name, "</{name}> closes another element");
        } else {
            let (tag, alone) = tag.strip_suffix('/').map_or((tag, false), |t| (t, true));
            all.push(element(tag));
            if !alone {
                open.push(all.len() - 1);
            }
        }
        rest = &rest[end + 1..];
    }
    assert!(open.is_empty() && rest.trim().is_empty(), "elements left open: {open:?}");
    all
}

fn element(tag: &str) -> Element {
    let (name, mut rest) = tag.split_once(' ').unwrap_or((tag, ""));
    assert!(name.chars().all(|c| c.is_ascii_alphanumeric()), "the tag name {name:?}");
    let mut element = Element { name: name.to_string(), ..Element::default() };
    while !rest.trim().is_empty() {
        let (key, after) = rest.split_once("=\"").unwrap_or_else(|| panic!("an attribute without value: {rest:?}"));
        let (value, after) = after.split_once('"').expect("an attribute that is not closed");
        assert!(element.get(key.trim()).is_empty(), "two attributes {key}");
        element.attributes.push((key.trim().to_string(), decode_entities(value)));
        rest = after;
    }
    element
}

pub fn decode_entities(text: &str) -> String {
    let known = ["amp", "lt", "gt", "quot", "#39"];
    for piece in text.split('&').skip(1) {
        let name = piece.split(';').next().unwrap_or_default();
        assert!(known.contains(&name), "a bare `&` before {piece:?}");
    }
    let plain = text.replace("&lt;", "<").replace("&gt;", ">").replace("&quot;", "\"").replace("&#39;", "'");
    plain.replace("&amp;", "&")
}

/// Decodes base64 by gathering bits.
pub fn decode_base64(text: &str) -> Vec<u8> {
    assert_eq!(text.len() % 4, 0, "base64 comes in fours");
    let (mut bytes, mut bits, mut count) = (Vec::new(), 0u32, 0);
    for character in text.trim_end_matches('=').bytes() {
        let value = match character {
            b'A'..=b'Z' => character - b'A',
            b'a'..=b'z' => character - b'a' + 26,
            b'0'..=b'9' => character - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            other => panic!("{other} is no base64 character"),
        };
        (bits, count) = (bits << 6 | u32::from(value), count + 6);
        if count >= 8 {
            count -= 8;
            bytes.push((bits >> count & 255) as u8);
        }
    }
    bytes
}
