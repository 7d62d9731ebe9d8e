//! Updates of many parameters.

use std::collections::BTreeMap;
use std::sync::Mutex;

use gradreel::Tensor;
use gradreel::optim::{Adam, Clip, Params, Sgd};

use crate::harness::{Case, numbers};

/// Parameters of a network of moderate size.
const COUNT: usize = 10 << 20;

pub fn cases() -> Vec<Case> {
    type Step = Box<dyn FnMut(&mut Params, &BTreeMap<String, Tensor>) + Send>;
    // `passes`: how often the numbers of one state cross memory, the pass over the gradients that checks them included
    let case = |name, passes: usize, mut step: Step| {
        let mut params: Params = [("x".to_owned(), numbers(1, [COUNT]))].into_iter().collect();
        let gradients = BTreeMap::from([("x".to_owned(), numbers(2, [COUNT]))]);
        step(&mut params, &gradients);
        let state = Mutex::new((params, step));
        let run = move |_| {
            let (params, step) = &mut *state.lock().expect("one user");
            step(params, &gradients);
        };
        Case { name, flop: 0.0, bytes: (4 * passes * COUNT) as f64, run: Box::new(run) }
    };
    let mut adam = Adam::new(1e-4).with_weight_decay(0.01);
    let mut clipped = adam.clone().with_clip(Clip::Norm(1.0));
    let mut sgd = Sgd::new(1e-4).with_momentum(0.9);
    vec![
        case(
            "AdamW update 10 Mi",
            8,
            Box::new(move |p, g| {
                adam.step(p, g).expect("a step");
            }),
        ),
        case(
            "AdamW update 10 Mi, clipped",
            8,
            Box::new(move |p, g| {
                clipped.step(p, g).expect("a step");
            }),
        ),
        case(
            "SGD momentum update 10 Mi",
            6,
            Box::new(move |p, g| {
                sgd.step(p, g).expect("a step");
            }),
        ),
    ]
}
