//! `manduca analyse sobol`.

use anyhow::Result;
use manduca_numerics::optimise::analysis::indices;
use manduca_numerics::parameters::{OUTPUTS, Point, TABLE};

use super::Subject;
use super::answer::{Answer, Cell, Column};
use crate::args::SobolArgs;

/// Sobol's indices of the four outputs, a row per parameter.
pub fn sobol(subject: &Subject, args: &SobolArgs) -> Result<Answer> {
    let predict = |points: &[Point], values: &mut [[f64; 4]]| subject.surrogate.predict_into(points, values);
    let found = indices(&predict, &subject.how.bounds, args.base, subject.seed)?;
    let mut answer = subject.answer("sobol", "Shares in the variance, alone (S) and in all (T)".into());
    answer.facts.insert("base".into(), args.base.into());
    answer.facts.insert(
        "variance".into(),
        OUTPUTS
            .iter()
            .zip(found.variance)
            .map(|(o, v)| (o.0.to_owned(), v.into()))
            .collect::<serde_json::Map<_, _>>()
            .into(),
    );
    answer.columns = vec![Column::new("parameter", "parameter", 0)];
    for (of, symbol) in [("first", "S"), ("total", "T")] {
        answer
            .columns
            .extend(OUTPUTS.iter().map(|o| Column::new(format!("{of}_{}", o.0), format!("{symbol} {}", o.2), 3)));
    }
    let row = |(i, p): (usize, &manduca_numerics::parameters::Parameter)| {
        let shares = found.first.iter().chain(&found.total).map(|shares| Cell::from(shares[i]));
        std::iter::once(Cell::Word(p.name)).chain(shares).collect()
    };
    answer.rows = TABLE.iter().enumerate().map(row).collect();
    Ok(answer)
}
