//! Searches side by side: what all of them ask for is evaluated together.

use gradreel::Result;

use super::evaluations::{Answer, Evaluations, Request};
use super::gauss_newton::GaussNewton;

/// Hears of each list of requests with its answers, if they are new.
pub(crate) type Each<'a> = dyn FnMut(&[Request], Option<&[Answer]>) -> Result<()> + 'a;

/// Runs searches side by side to their ends: in each turn all that have not ended ask once, and all they ask for is evaluated
/// together. `known` are answers from before an interruption, which are not computed again.
///
/// # Errors
/// What the evaluations and `each` return.
pub(crate) fn drive(
    evaluations: &dyn Evaluations,
    searches: &mut [GaussNewton<'_>],
    known: &[Answer],
    each: &mut Each<'_>,
) -> Result<()> {
    let mut known = known;
    loop {
        let asking: Vec<(usize, Request)> =
            searches.iter().enumerate().filter_map(|(k, search)| Some((k, search.next()?))).collect();
        if asking.is_empty() {
            return Ok(());
        }
        let (who, requests): (Vec<usize>, Vec<Request>) = asking.into_iter().unzip();
        if known.len() >= requests.len() {
            let (answers, rest) = known.split_at(requests.len());
            known = rest;
            each(&requests, None)?;
            who.iter().zip(answers).for_each(|(&k, answer)| searches[k].take(answer));
        } else {
            let answers = evaluations.evaluate(&requests)?;
            each(&requests, Some(&answers))?;
            who.iter().zip(&answers).for_each(|(&k, answer)| searches[k].take(answer));
        }
    }
}
