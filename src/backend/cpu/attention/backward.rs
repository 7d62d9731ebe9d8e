//! The backward pass: weights are recomputed block by block from the kept sums.
//!
//! With `P = exp(S − L)`, `O = P V` and the cotangent `G` of `O`: `dV = Pᵀ G`, `dP = G Vᵀ`,
//! `dS = P ∘ (dP − rowsum(G ∘ O))`, `dQ = scale · dS K`, `dK = scale · dSᵀ Q`.

use rayon::prelude::*;

use super::product::{Left, Product, Start};
use super::{Heads, KEYS, Panel, QUERIES, transpose};
use crate::backend::cpu::{buffer, pool, vectorised};
use crate::scalar::{Job, Lane, Real};

/// Work items to aim at: enough for many threads, few enough that their partial sums are small beside the work.
const ITEMS: usize = 16;

/// Cotangents of the operands.
pub(crate) struct Cotangents<T> {
    pub q: Vec<T>,
    pub k: Vec<T>,
    pub v: Vec<T>,
    /// Of the scores after the mask, `[heads, queries, keys]`, where it was asked for.
    pub scores: Option<Vec<T>>,
}

/// Cotangents from that of the result, `g`, and from what [`forward`](super::forward) returned.
pub(crate) fn backward<T: Real>(
    heads: &Heads<'_, T>,
    result: &[T],
    log_sums: &[T],
    g: &[T],
    scores_wanted: bool,
) -> Cotangents<T> {
    let &Heads { queries, keys, channels, values, .. } = heads;
    if heads.heads * queries * keys == 0 {
        let zeros = |len: usize| vec![T::ZERO; len];
        let scores = scores_wanted.then(Vec::new);
        return Cotangents { q: zeros(heads.q.len()), k: zeros(heads.k.len()), v: zeros(heads.v.len()), scores };
    }
    // each head's queries are cut into groups, each of which adds up its own share for keys and values
    let blocks = queries.div_ceil(QUERIES);
    let group = blocks.div_ceil(ITEMS.div_ceil(heads.heads).min(blocks)) * QUERIES;
    let groups = queries.div_ceil(group);
    let share = keys * (padded(channels) + padded(values));

    let mut q = buffer::<T>(heads.q.len());
    let mut shares = buffer::<T>(heads.heads * groups * share);
    let mut scores = scores_wanted.then(|| buffer::<T>(heads.heads * queries * keys));
    let mut items = Vec::new();
    let mut rest_of_q = &mut q[..];
    let mut rest_of_scores = scores.as_deref_mut().unwrap_or_default();
    for (number, share) in shares.chunks_mut(share).enumerate() {
        let (head, first) = (number / groups, number % groups * group);
        let count = group.min(queries - first);
        let (q, rest) = rest_of_q.split_at_mut(count * channels);
        let (scores, others) = rest_of_scores.split_at_mut(if scores_wanted { count * keys } else { 0 });
        (rest_of_q, rest_of_scores) = (rest, others);
        items.push(Item { head, first, count, q, share, scores });
    }
    let given = Given { heads, result, log_sums, g };
    items.into_par_iter().for_each_init(|| Scratch::new(heads), |scratch, item| scratch.item(&given, item));

    let (mut k, mut v) = (buffer::<T>(heads.k.len()), buffer::<T>(heads.v.len()));
    k.par_chunks_mut(keys * channels).zip(v.par_chunks_mut(keys * values)).enumerate().for_each(|(head, (k, v))| {
        let shares = &shares[head * groups * share..][..groups * share];
        sum_shares(shares, share, 0, channels, k);
        sum_shares(shares, share, keys * padded(channels), values, v);
    });
    pool::give(shares);
    Cotangents { q, k, v, scores }
}

/// A width as panels of rows have it.
fn padded(width: usize) -> usize {
    width.next_multiple_of(16)
}

/// Adds up the groups' shares, in their order, without the padding.
fn sum_shares<T: Real>(shares: &[T], share: usize, start: usize, width: usize, sums: &mut [T]) {
    for (row, sums) in sums.chunks_mut(width).enumerate() {
        for (number, share) in shares.chunks(share).enumerate() {
            let part = &share[start + row * padded(width)..][..width];
            for (sum, x) in sums.iter_mut().zip(part) {
                *sum = if number == 0 { *x } else { *sum + *x };
            }
        }
    }
}

struct Given<'a, T> {
    heads: &'a Heads<'a, T>,
    result: &'a [T],
    log_sums: &'a [T],
    g: &'a [T],
}

/// Some queries of a head.
struct Item<'a, T> {
    head: usize,
    first: usize,
    count: usize,
    /// Their cotangents.
    q: &'a mut [T],
    /// Their part in the cotangents of keys and values: rows of padded width.
    share: &'a mut [T],
    /// Their rows of the cotangent of the scores, or nothing.
    scores: &'a mut [T],
}

/// Panels of one block of queries.
struct Scratch<T> {
    /// Columns are queries.
    queries: Panel<T>,
    g: Panel<T>,
    weights: Panel<T>,
    slopes: Panel<T>,
    q: Panel<T>,
    /// Rows are queries, padded to whole vectors.
    query_rows: Panel<T>,
    g_rows: Panel<T>,
    log_sums: [T; QUERIES],
    means: [T; QUERIES],
}

impl<T: Real> Scratch<T> {
    fn new(heads: &Heads<'_, T>) -> Self {
        let panel = |rows: usize| Panel::new(rows * QUERIES);
        Self {
            queries: panel(heads.channels),
            g: panel(heads.values),
            weights: panel(KEYS),
            slopes: panel(KEYS),
            q: panel(heads.channels),
            query_rows: panel(padded(heads.channels)),
            g_rows: panel(padded(heads.values)),
            log_sums: [T::ZERO; QUERIES],
            means: [T::ZERO; QUERIES],
        }
    }

    fn item(&mut self, given: &Given<'_, T>, item: Item<'_, T>) {
        let &Heads { keys, channels, .. } = given.heads;
        for block in (0..item.count).step_by(QUERIES) {
            let count = QUERIES.min(item.count - block);
            let scores =
                if item.scores.is_empty() { &mut [] } else { &mut item.scores[block * keys..][..count * keys] };
            let place = (item.head, item.first + block);
            self.block(
                given,
                place,
                &mut item.q[block * channels..][..count * channels],
                item.share,
                scores,
                block == 0,
            );
        }
    }

    fn block(
        &mut self,
        given: &Given<'_, T>,
        (head, first): (usize, usize),
        q: &mut [T],
        share: &mut [T],
        scores: &mut [T],
        starts_share: bool,
    ) {
        let heads = given.heads;
        let &Heads { channels, values, .. } = heads;
        let count = q.len() / channels;
        let at = head * heads.queries + first;
        let (query_rows, g_rows) =
            (&heads.q[at * channels..][..count * channels], &given.g[at * values..][..count * values]);
        transpose(query_rows, channels, heads.scale, &mut self.queries);
        transpose(g_rows, values, T::ONE, &mut self.g);
        pad(query_rows, channels, heads.scale, &mut self.query_rows);
        pad(g_rows, values, T::ONE, &mut self.g_rows);
        // weights of the columns beyond the queries are 0
        self.log_sums.fill(T::INFINITY);
        self.log_sums[..count].copy_from_slice(&given.log_sums[at..][..count]);
        self.means.fill(T::ZERO);
        let results = given.result[at * values..].chunks(values);
        for ((mean, g), result) in self.means.iter_mut().zip(g_rows.chunks(values)).zip(results) {
            *mean = g.iter().zip(result).map(|(g, y)| *g * *y).sum();
        }
        let (share_k, share_v) = share.split_at_mut(heads.keys * padded(channels));
        let start = if starts_share { Start::Zero } else { Start::Result };
        for key in (0..heads.keys).step_by(KEYS) {
            let keys = KEYS.min(heads.keys - key);
            let at = head * heads.keys + key;
            let k = &heads.k[at * channels..][..keys * channels];
            let v = &heads.v[at * values..][..keys * values];
            Product {
                rows: keys,
                depth: channels,
                columns: QUERIES,
                left: Left { values: k, row_step: channels, depth_step: 1 },
                right: &self.queries,
                result: &mut self.weights,
                start: Start::Zero,
            }
            .run();
            heads.add_mask(&mut self.weights[..keys * QUERIES], head, first, count, key);
            Product {
                rows: keys,
                depth: values,
                columns: QUERIES,
                left: Left { values: v, row_step: values, depth_step: 1 },
                right: &self.g,
                result: &mut self.slopes,
                start: Start::Zero,
            }
            .run();
            let job = Slopes {
                weights: &mut self.weights[..keys * QUERIES],
                slopes: &mut self.slopes[..keys * QUERIES],
                log_sums: &self.log_sums,
                means: &self.means,
            };
            // SAFETY: weights and slopes are as many whole rows of 64.
            unsafe { vectorised(job) };
            let by_key = |panel| Left { values: panel, row_step: QUERIES, depth_step: 1 };
            Product {
                rows: keys,
                depth: QUERIES,
                columns: padded(values),
                left: by_key(&self.weights),
                right: &self.g_rows,
                result: &mut share_v[key * padded(values)..],
                start,
            }
            .run();
            Product {
                rows: keys,
                depth: QUERIES,
                columns: padded(channels),
                left: by_key(&self.slopes),
                right: &self.query_rows,
                result: &mut share_k[key * padded(channels)..],
                start,
            }
            .run();
            Product {
                rows: channels,
                depth: keys,
                columns: QUERIES,
                left: Left { values: k, row_step: 1, depth_step: channels },
                right: &self.slopes,
                result: &mut self.q,
                start: if key == 0 { Start::Zero } else { Start::Result },
            }
            .run();
            for (i, row) in scores.chunks_mut(heads.keys).enumerate() {
                for (j, slope) in row[key..key + keys].iter_mut().enumerate() {
                    *slope = self.slopes[j * QUERIES + i];
                }
            }
        }
        for (i, row) in q.chunks_mut(channels).enumerate() {
            for (channel, x) in row.iter_mut().enumerate() {
                *x = self.q[channel * QUERIES + i] * heads.scale;
            }
        }
    }
}

/// Copies rows times `factor` into rows of padded width; what is beyond them becomes 0.
fn pad<T: Real>(rows: &[T], width: usize, factor: T, panel: &mut [T]) {
    panel.fill(T::ZERO);
    for (row, panel) in rows.chunks(width).zip(panel.chunks_mut(padded(width))) {
        for (x, out) in row.iter().zip(panel) {
            *out = *x * factor;
        }
    }
}

/// Scores into weights `exp(score − log_sum)`, and cotangents of weights into those of scores,
/// `weight · (cotangent − mean)`.
struct Slopes<'a, T> {
    weights: &'a mut [T],
    slopes: &'a mut [T],
    log_sums: &'a [T; QUERIES],
    means: &'a [T; QUERIES],
}

impl<T: Real> Job<T> for Slopes<'_, T> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let keys = self.weights.len() / QUERIES;
        let mut column = 0;
        while column < QUERIES {
            // SAFETY: columns below 64 of arrays and rows of 64.
            unsafe {
                let log_sum = V::load(self.log_sums.as_ptr().add(column));
                let mean = V::load(self.means.as_ptr().add(column));
                for key in 0..keys {
                    let at = key * QUERIES + column;
                    let weight = V::load(self.weights.as_ptr().add(at)).sub(log_sum).exp_of_negative();
                    let slope = V::load(self.slopes.as_ptr().add(at)).sub(mean);
                    weight.store(self.weights.as_mut_ptr().add(at));
                    weight.mul(slope).store(self.slopes.as_mut_ptr().add(at));
                }
            }
            column += V::WIDTH;
        }
    }
}
