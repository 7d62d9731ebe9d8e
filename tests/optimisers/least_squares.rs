//! Levenberg–Marquardt on problems with known answers.

use gradreel::optim::{LevenbergMarquardt, Residuals, Stop};
use gradreel::{ErrorKind, ops};

#[test]
fn rosenbrocks_valley() {
    let mut calls = 0;
    let fit = LevenbergMarquardt::default()
        .minimise(&[-1.2, 1.0], &mut |x, jacobian| {
            calls += 1;
            let columns = if jacobian { vec![vec![-20.0 * x[0], -1.0], vec![10.0, 0.0]] } else { Vec::new() };
            Ok(Residuals { values: vec![10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]], columns })
        })
        .unwrap();
    assert!((fit.point[0] - 1.0).abs() < 1e-9 && (fit.point[1] - 1.0).abs() < 1e-9, "{fit:?}");
    assert!(fit.evaluations < 60 && calls == fit.evaluations + fit.jacobians - 1, "{calls} calls, {fit:?}");
    assert!(fit.cost < 1e-18 && fit.variance.is_none() && fit.undetermined.is_empty());
    assert!(fit.standard_errors()[0].is_nan());
}

/// `y = a + b t` with fixed noise: estimates and covariance have closed forms.
#[test]
fn a_line_has_the_covariance_of_the_textbook() {
    for unit in [1.0, 1e-9, 1e7] {
        let n = 50;
        let t: Vec<f64> = (0..n).map(|i| 0.1 * f64::from(i)).collect();
        let noise = ops::uniform(3, [50], -0.1..0.1).to_vec().unwrap();
        let y: Vec<f64> = t.iter().zip(&noise).map(|(t, e)| 1.0 + 2.0 * t + e).collect();
        let fit = LevenbergMarquardt::default()
            .minimise(&[0.0, 0.0], &mut |x, _| {
                Ok(Residuals {
                    values: t.iter().zip(&y).map(|(t, y)| x[0] + x[1] / unit * t - y).collect(),
                    columns: vec![vec![1.0; t.len()], t.iter().map(|t| t / unit).collect()],
                })
            })
            .unwrap();
        let (mean_t, mean_y) = (t.iter().sum::<f64>() / 50.0, y.iter().sum::<f64>() / 50.0);
        let sxx: f64 = t.iter().map(|t| (t - mean_t).powi(2)).sum();
        let b = t.iter().zip(&y).map(|(t, y)| (t - mean_t) * (y - mean_y)).sum::<f64>() / sxx;
        let a = mean_y - b * mean_t;
        let rest: f64 = t.iter().zip(&y).map(|(t, y)| (a + b * t - y).powi(2)).sum();
        let variance = rest / 48.0;
        let close = |found: f64, wanted: f64| assert!((found / wanted - 1.0).abs() < 1e-7, "{found}, not {wanted}");
        close(fit.point[0], a);
        close(fit.point[1], b * unit);
        close(fit.variance.unwrap(), variance);
        close(fit.covariance[1][1], variance / sxx * unit * unit);
        close(fit.covariance[0][0], variance * (1.0 / 50.0 + mean_t * mean_t / sxx));
        close(fit.covariance[0][1], -variance * mean_t / sxx * unit);
        close(fit.standard_errors()[1], (variance / sxx).sqrt() * unit);
        assert!(fit.undetermined.is_empty() && fit.evaluations < 30, "{fit:?}");
    }
}

#[test]
fn directions_without_information_are_reported() {
    // only the product of the first two matters; the fourth does nothing at all
    let t: Vec<f64> = (1..30).map(|i| 0.1 * f64::from(i)).collect();
    let fit = LevenbergMarquardt::default()
        .minimise(&[1.0, 2.0, 0.5, 7.0], &mut |x, _| {
            let wave = |t: f64| (x[2] * t).sin();
            Ok(Residuals {
                values: t
                    .iter()
                    .map(|t| x[0] * x[1] * wave(*t) - 3.0 * (0.8 * t).sin() - 0.01 * (37.0 * t).cos())
                    .collect(),
                columns: vec![
                    t.iter().map(|t| x[1] * wave(*t)).collect(),
                    t.iter().map(|t| x[0] * wave(*t)).collect(),
                    t.iter().map(|t| x[0] * x[1] * t * (x[2] * t).cos()).collect(),
                    vec![0.0; t.len()],
                ],
            })
        })
        .unwrap();
    assert!((fit.point[0] * fit.point[1] - 3.0).abs() < 0.01 && (fit.point[2] - 0.8).abs() < 0.01, "{fit:?}");
    assert_eq!(fit.point[3], 7.0);
    assert_eq!(fit.undetermined.len(), 2, "{fit:?}");
    // the Jacobian has no part along them: (x₀, −x₁, 0, 0) and (0, 0, 0, 1)
    for direction in &fit.undetermined {
        let product_changes = direction[0] * fit.point[1] + direction[1] * fit.point[0];
        assert!(product_changes.abs() < 1e-8 && direction[2].abs() < 1e-8, "{direction:?}");
    }
    let errors = fit.standard_errors();
    assert!(errors[0].is_infinite() && errors[1].is_infinite() && errors[3].is_infinite());
    assert!(errors[2] > 0.0 && errors[2] < 0.01, "{errors:?}");
}

#[test]
fn fewer_residuals_than_parameters() {
    let fit = LevenbergMarquardt::default()
        .minimise(&[0.0, 0.0, 0.0], &mut |x, _| {
            Ok(Residuals { values: vec![x[0] + x[1] - 2.0], columns: vec![vec![1.0], vec![1.0], vec![0.0]] })
        })
        .unwrap();
    assert!((fit.point[0] - 1.0).abs() < 1e-9 && (fit.point[1] - 1.0).abs() < 1e-9 && fit.point[2] == 0.0);
    assert_eq!((fit.undetermined.len(), fit.variance), (2, None));
}

#[test]
fn searches_end_with_a_reason() {
    // a step into the region without residuals is taken back
    let mut log = |x: &[f64], _: bool| Ok(Residuals { values: vec![x[0].ln() - 1.0], columns: vec![vec![1.0 / x[0]]] });
    let fit = LevenbergMarquardt::default().minimise(&[20.0], &mut log).unwrap();
    assert!((fit.point[0] - 1f64.exp()).abs() < 1e-9, "{fit:?}");

    let few = LevenbergMarquardt { evaluations: 3, ..LevenbergMarquardt::default() };
    let fit = few.minimise(&[20.0], &mut log).unwrap();
    assert_eq!((fit.stop, fit.evaluations), (Stop::Evaluations, 3));

    let error = LevenbergMarquardt::default().minimise(&[-1.0], &mut log).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::NonFinite);

    // a step to where there is no derivative is taken back, too
    let mut edge = |x: &[f64], _: bool| {
        let slope = if x[0] < 0.5 { f64::NAN } else { 1.0 / x[0] };
        Ok(Residuals { values: vec![x[0].ln()], columns: vec![vec![slope]] })
    };
    let fit = LevenbergMarquardt::default().minimise(&[2.2], &mut edge).unwrap();
    assert!((fit.point[0] - 1.0).abs() < 1e-9, "{fit:?}");
    let error = LevenbergMarquardt::default().minimise(&[0.4], &mut edge).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::NonFinite);

    // a Jacobian of the wrong sign
    let fit = LevenbergMarquardt::default()
        .minimise(&[1.0], &mut |x, _| Ok(Residuals { values: vec![x[0]], columns: vec![vec![-1.0]] }))
        .unwrap();
    assert!(matches!(fit.stop, Stop::Stalled | Stop::Step) && fit.point == [1.0], "{fit:?}");

    let error = LevenbergMarquardt::default()
        .minimise(&[1.0], &mut |x, _| Ok(Residuals { values: vec![x[0]], columns: vec![vec![1.0, 2.0]] }))
        .unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Shape);
}
