//! Damage that keeps much of a file intact.

use gradreel::Key;

/// What a pickle is made of.
pub const OPCODES: [&[u8]; 24] = [
    b"\x80\x02",
    b"(",
    b"t",
    b"}",
    b"]",
    b")",
    b"R",
    b"Q",
    b"b",
    b"u",
    b"s",
    b"a",
    b"e",
    b"0",
    b"2",
    b"N",
    b"\x85",
    b"\x87",
    b"h\x00",
    b"q\x01",
    b"K\xff",
    b"\x8a\x08\xff\xff\xff\xff\xff\xff\xff\x7f",
    b"J\xff\xff\xff\xff",
    b"ctorch._utils\n_rebuild_tensor_v2\n",
];

/// Numbers from a seed, one after the other.
pub struct Mutator {
    key: Key,
    drawn: u64,
}

impl Mutator {
    pub fn new(seed: u64, run: u64) -> Self {
        Self { key: Key::new(seed).fold(run), drawn: 0 }
    }

    fn below(&mut self, bound: usize) -> usize {
        self.drawn += 1;
        self.key.fold(self.drawn).below(bound.max(1), 1).next().expect("one number")
    }

    /// A file of the corpus with one to eight injuries.
    pub fn mutate(&mut self, corpus: &[Vec<u8>], tokens: &[&[u8]]) -> Vec<u8> {
        let mut file = corpus[self.below(corpus.len())].clone();
        for _ in 0..=self.below(8) {
            self.injure(&mut file, corpus, tokens);
        }
        file
    }

    fn injure(&mut self, file: &mut Vec<u8>, corpus: &[Vec<u8>], tokens: &[&[u8]]) {
        if file.is_empty() {
            return;
        }
        let at = self.below(file.len());
        let len = (1 + self.below(16)).min(file.len() - at);
        match self.below(9) {
            0 => file[at] ^= 1 << self.below(8),
            1 => file[at] = self.below(256) as u8,
            2 => file[at..at + len].fill([0, 0x7f, 0xff][self.below(3)]),
            3 => drop(file.drain(at..at + len)),
            4 => {
                let piece = file[at..at + len].repeat(1 + self.below(40));
                file.splice(at..at, piece);
            }
            5 => {
                let token = tokens[self.below(tokens.len())];
                file.splice(at..at, token.iter().copied());
            }
            6 => {
                let token = tokens[self.below(tokens.len())];
                let end = (at + token.len()).min(file.len());
                file.splice(at..end, token.iter().copied());
            }
            7 => {
                let other = &corpus[self.below(corpus.len())];
                let from = self.below(other.len());
                let piece = &other[from..(from + 64).min(other.len())];
                let end = (at + piece.len()).min(file.len());
                file.splice(at..end, piece.iter().copied());
            }
            _ if self.below(8) == 0 => file.truncate(at),
            _ => {
                let small = self.below(20) as u8;
                file[at] = file[at].wrapping_add(small);
            }
        }
    }
}
