//! Small networks as ONNX files, written field by field.

/// A convolution of single pixels that makes channels of three, and an operator after it.
pub struct Network {
    /// The shapes of the inputs, the first of which is the picture; `None` for open sides.
    pub inputs: Vec<[Option<u64>; 4]>,
    /// The type of the picture's numbers; 1 is float32.
    pub numbers: u64,
    /// Weights of red, green and blue.
    pub weights: [f32; 3],
    pub bias: f32,
    /// So many channels that are all the same.
    pub channels: u64,
    /// The operator, with its axes if it has any.
    pub last: (&'static str, &'static [u64]),
}

impl Network {
    /// One for pictures of this size, if it is given, that ends in a sigmoid: of a weighted sum of the colours.
    pub fn of(side: Option<u64>, weights: [f32; 3], bias: f32) -> Self {
        let inputs = vec![[Some(1), Some(3), side, side]];
        Self { inputs, numbers: 1, weights, bias, channels: 1, last: ("Sigmoid", &[]) }
    }

    pub fn bytes(&self) -> Vec<u8> {
        let node = |kind: &str, from: &[&str], to: &str, attributes: &[(&str, &[u64])]| {
            let from: Vec<u8> = from.iter().flat_map(|name| field(1, name.as_bytes())).collect();
            let attribute = |(name, values): &(&str, &[u64])| {
                let integers: Vec<u8> = values.iter().flat_map(|value| count(8, *value)).collect();
                field(5, &[field(1, name.as_bytes()), integers, count(20, 7)].concat())
            };
            let attributes: Vec<u8> = attributes.iter().flat_map(attribute).collect();
            field(1, &[from, field(2, to.as_bytes()), field(4, kind.as_bytes()), attributes].concat())
        };
        let tensor = |name: &str, shape: &[u64], values: Vec<f32>| {
            let shape: Vec<u8> = shape.iter().flat_map(|side| count(1, *side)).collect();
            let raw: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
            field(5, &[shape, count(2, 1), field(8, name.as_bytes()), field(9, &raw)].concat())
        };
        let value = |number: u64, name: &str, shape: &[Option<u64>]| {
            let side = |side: &Option<u64>| side.map_or(field(2, b"open"), |side| count(1, side));
            let shape: Vec<u8> = shape.iter().flat_map(|one| field(1, &side(one))).collect();
            let kind = field(1, &[count(1, self.numbers), field(2, &shape)].concat());
            field(number, &[field(1, name.as_bytes()), field(2, &kind)].concat())
        };
        let (kind, axes) = (self.last.0, [("axes", self.last.1)]);
        let weights = self.weights.repeat(self.channels as usize);
        let mut graph = [
            node(
                "Conv",
                &["in0", "weights", "bias"],
                "sum",
                &[("strides", &[1, 1]), ("dilations", &[1, 1]), ("pads", &[0; 4])],
            ),
            node(kind, &["sum"], "out", if self.last.1.is_empty() { &[] } else { &axes }),
            tensor("weights", &[self.channels, 3, 1, 1], weights),
            tensor("bias", &[self.channels], vec![self.bias; self.channels as usize]),
        ]
        .concat();
        for (k, shape) in self.inputs.iter().enumerate() {
            graph.extend(value(11, &format!("in{k}"), shape));
        }
        graph.extend(field(12, &field(1, b"out")));
        // version 8 of the format, 13 of the operators
        [count(1, 8), field(7, &graph), field(8, &count(2, 13))].concat()
    }
}

/// A field that holds bytes: a text, a message, or raw numbers.
pub fn field(number: u64, bytes: &[u8]) -> Vec<u8> {
    [varint(number << 3 | 2), varint(bytes.len() as u64), bytes.to_vec()].concat()
}

/// A field that holds an integer.
fn count(number: u64, value: u64) -> Vec<u8> {
    [varint(number << 3), varint(value)].concat()
}

fn varint(mut value: u64) -> Vec<u8> {
    let mut bytes = vec![];
    while value > 0x7f {
        bytes.push((value & 0x7f) as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
    bytes
}
