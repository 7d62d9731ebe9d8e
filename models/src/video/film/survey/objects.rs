//! Which of the things that fall is the object.

use super::chain::Chain;
use super::metres::Size;
use super::search::Scene;

/// Evidence of a chain as a share of the best one's: from the first on it is another object, from the second on it is the object if it
/// is the largest.
const SHARES: [f64; 2] = [0.3, 0.8];

/// Two chains are of one object where they are nearer than so many of their widths in half of the pictures that both have.
const NEAR: f64 = 1.0;

/// Least contrast of an object as a share of the best one's: a shadow that falls along is fainter.
const CLEAR: f64 = 0.6;

/// Chains of different objects that fall at the same time: first the object by itself, then the others, the largest first. `all` begins
/// with the best.
pub(super) fn apart(scene: &Scene<'_>, all: Vec<Chain>) -> Vec<(Chain, Size)> {
    let Some(best) = all.first().cloned() else { return vec![] };
    let mut found: Vec<(Chain, Size)> = Vec::new();
    for chain in all {
        let counts = chain.score >= SHARES[0] * best.score && contrast(scene, &chain) >= CLEAR * contrast(scene, &best);
        let is_new = |other: &(Chain, Size)| are_apart(scene, &chain, &other.0);
        if found.is_empty() || counts && found.iter().all(is_new) {
            let size = Size::of(scene, &chain);
            found.push((chain, size));
        }
    }
    found[1..].sort_by(|a, b| b.1.metres.total_cmp(&a.1.metres));
    let larger = |k: usize| found[k].1.metres > found[0].1.metres && found[k].0.score >= SHARES[1] * best.score;
    if found.len() > 1 && larger(1) {
        found.swap(0, 1);
        found[1..].sort_by(|a, b| b.1.metres.total_cmp(&a.1.metres));
    }
    found
}

/// Median contrast of the components of a chain.
fn contrast(scene: &Scene<'_>, chain: &Chain) -> f64 {
    let spots = chain.links.iter().flat_map(|link| &link.flight.members);
    super::flight::middle(spots.map(|spot| scene.piece(*spot).contrast).collect())
}

/// Whether two chains fall at the same time in different places.
fn are_apart(scene: &Scene<'_>, a: &Chain, b: &Chain) -> bool {
    let spots = |chain: &Chain| -> Vec<(usize, usize)> {
        chain.links.iter().flat_map(|link| link.flight.members.iter().copied()).collect()
    };
    let (ours, theirs) = (spots(a), spots(b));
    let mut both = 0;
    let mut near = 0;
    for (k, i) in &ours {
        let Some((_, j)) = theirs.iter().find(|(other, _)| other == k) else { continue };
        let [one, other] = [i, j].map(|piece| &scene.pieces[*k][*piece]);
        let distance = (one.middle[0] - other.middle[0]).hypot(one.middle[1] - other.middle[1]);
        both += 1;
        near += usize::from(i == j || distance < NEAR * 0.5 * (one.across() + other.across()));
    }
    both >= 3 && 2 * near < both
}
