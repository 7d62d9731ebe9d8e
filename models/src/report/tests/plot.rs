//! Plots: well-formed SVG, points where they belong, ticks a person would choose.

use crate::report::plot::{Plot, Series};

use super::markup::{Element, read};

fn plot(log_y: bool, series: Vec<Vec<(f64, f64)>>) -> Plot {
    let series = series.into_iter().enumerate().map(|(i, points)| Series { label: format!("curve {i}"), points });
    Plot {
        title: "Loss".into(),
        x_label: "iteration".into(),
        y_label: "loss [1]".into(),
        log_y,
        series: series.collect(),
        reference: None,
    }
}

fn texts(elements: &[Element]) -> Vec<&str> {
    elements.iter().filter(|e| e.name == "text").map(|e| e.text.as_str()).collect()
}

/// The commands of the curves: `M` or `L` and the coordinates.
fn curves(elements: &[Element]) -> Vec<Vec<(char, f64, f64)>> {
    let paths = elements.iter().filter(|e| e.get("class").starts_with("series-") && e.get("stroke-width") == "2");
    paths.map(|e| commands(e.get("d"))).collect()
}

fn commands(d: &str) -> Vec<(char, f64, f64)> {
    let starts: Vec<usize> = d.match_indices(['M', 'L']).map(|m| m.0).chain([d.len()]).collect();
    let command = |w: &[usize]| {
        let (x, y) = d[w[0] + 1..w[1]].split_once(' ').expect("two coordinates");
        (d.as_bytes()[w[0]] as char, x.parse().expect("x"), y.parse().expect("y"))
    };
    starts.windows(2).map(command).collect()
}

fn field(elements: &[Element]) -> [f64; 4] {
    let rectangle = elements.iter().find(|e| e.name == "rect").expect("the field of the plot");
    ["x", "y", "width", "height"].map(|name| rectangle.get(name).parse().expect("a number"))
}

#[test]
fn points_lie_where_the_axes_say() {
    let elements = read(&plot(false, vec![vec![(0.0, 0.0), (5.0, 1.0), (10.0, 4.0)]]).svg());
    let [x, y, width, height] = field(&elements);
    let line = &curves(&elements)[0];
    assert_eq!(line.iter().map(|c| c.0).collect::<String>(), "MLL");
    let horizontal: Vec<f64> = line.iter().map(|c| (c.1 - x) / width).collect();
    assert!(horizontal.iter().zip([0.0, 0.5, 1.0]).all(|(a, b)| (a - b).abs() < 1e-4), "{horizontal:?}");
    // A margin of 6 % above and below: the range of 4 is drawn over 1 / 1.12 of the height.
    let vertical: Vec<f64> = line.iter().map(|c| (y + height - c.2) / height).collect();
    let expected = [0.0, 1.0, 4.0].map(|v| (v / 4.0 + 0.06) / 1.12);
    assert!(vertical.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-4), "{vertical:?}");
}

#[test]
fn equal_ratios_are_equal_distances_on_a_logarithmic_axis() {
    let elements = read(&plot(true, vec![vec![(0.0, 1.0), (1.0, 1e-2), (2.0, 1e-4)]]).svg());
    let line = &curves(&elements)[0];
    assert!((line[1].2 - line[0].2 - (line[2].2 - line[1].2)).abs() < 0.02, "{line:?}");
    let texts = texts(&elements);
    assert!(["10⁰", "10⁻¹", "10⁻²", "10⁻³", "10⁻⁴"].iter().all(|tick| texts.contains(tick)), "{texts:?}");
}

#[test]
fn ticks_are_round_numbers() {
    let ticks = |log, low: f64, high: f64| {
        let elements = read(&plot(log, vec![vec![(0.0, low), (1.0, high)]]).svg());
        let labels = elements.into_iter().filter(|e| e.get("text-anchor") == "end").map(|e| e.text);
        labels.collect::<Vec<String>>()
    };
    assert_eq!(ticks(false, 0.0, 1.0), ["0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
    assert_eq!(ticks(false, -3.0, 3.0), ["−3", "−2", "−1", "0", "1", "2", "3"]);
    assert_eq!(ticks(false, 0.0, 9e5), ["0", "2×10⁵", "4×10⁵", "6×10⁵", "8×10⁵"]);
    assert_eq!(ticks(false, 0.0, 2e-4), ["0", "0.5×10⁻⁴", "1.0×10⁻⁴", "1.5×10⁻⁴", "2.0×10⁻⁴"]);
    assert_eq!(ticks(true, 40.0, 900.0), ["50", "100", "200", "500", "1000"]);
    assert_eq!(ticks(true, 0.5, 5e3), ["1", "10", "100", "1000"]);
    assert_eq!(ticks(true, 3e6, 4e7), ["5×10⁶", "10⁷", "2×10⁷"]);
    assert_eq!(ticks(true, 30.0, 80.0), ["30", "40", "50", "60", "70", "80"]);
}

#[test]
fn points_that_are_not_finite_interrupt_the_curve_and_are_counted() {
    let points =
        vec![(0.0, 1.0), (1.0, 2.0), (2.0, f64::NAN), (3.0, 3.0), (4.0, f64::INFINITY), (5.0, 2.0), (6.0, 1.0)];
    let svg = plot(false, vec![points]).svg();
    assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    let elements = read(&svg);
    assert_eq!(curves(&elements)[0].iter().map(|c| c.0).collect::<String>(), "MLMML");
    assert!(texts(&elements).contains(&"2 points are not shown: not finite"));
}

#[test]
fn a_logarithmic_axis_leaves_out_what_is_not_positive() {
    let svg = plot(true, vec![vec![(0.0, 1.0), (1.0, 0.0), (2.0, -1.0), (3.0, 0.1)]]).svg();
    assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    assert!(texts(&read(&svg)).contains(&"2 points are not shown: not finite or not positive"));
}

#[test]
fn nothing_to_show_is_said() {
    for series in [vec![], vec![vec![]], vec![vec![(0.0, f64::NAN)], vec![]]] {
        assert!(texts(&read(&plot(false, series).svg())).contains(&"no points to show"));
    }
}

#[test]
fn extreme_values_stay_inside_the_field() {
    let lists = [
        vec![(0.0, 5.0)],
        vec![(0.0, 0.0), (1.0, 0.0)],
        vec![(0.0, f64::MAX), (1.0, -f64::MAX)],
        vec![(0.0, 1e-308), (1.0, 5e-324)],
        vec![(1e300, 1.0), (-1e300, 2.0)],
        vec![(0.0, 1.0), (1.0, 1.0 + f64::EPSILON)],
    ];
    for points in lists {
        for log in [false, true] {
            let svg = plot(log, vec![points.clone()]).svg();
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{points:?}: {svg}");
            let elements = read(&svg);
            let [x, y, width, height] = field(&elements);
            for (_, px, py) in curves(&elements).concat() {
                let inside =
                    (x - 0.01..=x + width + 0.01).contains(&px) && (y - 0.01..=y + height + 0.01).contains(&py);
                assert!(inside, "{points:?} (log: {log}) is drawn at {px}, {py}");
            }
        }
    }
}

#[test]
fn the_reference_is_a_dashed_line_inside_the_range_and_named() {
    let reference = Some(("true value".to_string(), 10.0));
    let elements = read(&Plot { reference, ..plot(false, vec![vec![(0.0, 1.0), (1.0, 2.0)]]) }.svg());
    let [_, y, _, height] = field(&elements);
    let line = elements.iter().find(|e| e.get("class") == "reference").expect("the line");
    let level = line.get("d").split([' ', 'H']).nth(1).expect("a height").parse::<f64>().expect("a number");
    // The range is 1 … 10 with 6 % on each side.
    assert!((level - (y + height * 0.06 / 1.12)).abs() < 0.02, "{level}");
    assert!(!line.get("stroke-dasharray").is_empty() && texts(&elements).contains(&"true value"));
}

#[test]
fn names_are_escaped() {
    let mut hostile = plot(false, vec![vec![(0.0, 1.0), (1.0, 2.0)], vec![(0.0, 2.0)]]);
    hostile.title = "a < b & \"c\" </text><script>".into();
    hostile.series[0].label = "</svg>".into();
    hostile.y_label = "\u{1}'".into();
    let elements = read(&hostile.svg());
    let texts = texts(&elements);
    assert!(texts.contains(&hostile.title.as_str()) && texts.contains(&"</svg>") && texts.contains(&"\u{fffd}'"));
    assert!(elements.iter().all(|e| e.name != "script"));
}
