//! Memory sizes as typed by users.

use std::str::FromStr;

/// Bytes, written as `500MB`, `1.5 GB`, `2GiB` or a plain number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Size(pub usize);

const UNITS: [(&str, f64); 9] = [
    ("KIB", 1024.0),
    ("MIB", 1_048_576.0),
    ("GIB", 1_073_741_824.0),
    ("KB", 1e3),
    ("MB", 1e6),
    ("GB", 1e9),
    ("K", 1e3),
    ("M", 1e6),
    ("G", 1e9),
];

impl FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let upper = text.trim().to_uppercase();
        let unit = UNITS.iter().find_map(|(unit, bytes)| Some((upper.strip_suffix(unit)?, *bytes)));
        let (number, bytes) = unit.unwrap_or((upper.strip_suffix('B').unwrap_or(&upper), 1.0));
        match number.trim_end().parse::<f64>() {
            Ok(number) if number > 0.0 && number * bytes < 1e18 => Ok(Self((number * bytes) as usize)),
            _ => Err("an amount such as 500MB, 4GB or 2GiB is wanted".into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Size;

    #[test]
    fn amounts_of_memory() {
        let bytes = |text: &str| text.parse::<Size>().map(|size| size.0).ok();
        assert_eq!(bytes("500MB"), Some(500_000_000));
        assert_eq!(bytes("1.5 gb"), Some(1_500_000_000));
        assert_eq!(bytes("2GiB"), Some(2 << 30));
        assert_eq!(bytes("64 B"), Some(64));
        assert_eq!(bytes(" 7k "), Some(7000));
        for wrong in ["", "GB", "-1GB", "0", "nan", "infGB", "1e30GB", "3 TB", "4 G B"] {
            assert_eq!(bytes(wrong), None, "{wrong}");
        }
    }
}
