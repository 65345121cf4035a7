//! The files beside a simulation: its history and its wake.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use manduca_numerics::history::{Recorder, Steps, StepsError, record};
use manduca_numerics::simulation::{Infeasible, Means, Model, SOLVER_VERSION, Simulation};
use manduca_protocol::history::{AXES, History, HistoryRow, SENSE, SIDE, WakeHistory, WakeStep};
use manduca_protocol::point::ParameterValues;
use serde::Serialize;

use super::vtk;
use crate::args::RecordArgs;
use crate::endings;
use crate::exit::refused;
use crate::file::Draft;
use crate::output::note;

/// How a history is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Csv,
    Json,
    NdJson,
}

/// What is recorded of a flight and where it goes.
#[derive(Debug)]
pub struct Records {
    history: Option<(PathBuf, Format)>,
    wake: Option<PathBuf>,
    vtk: Option<PathBuf>,
    /// The steps whose rings are wanted.
    steps: Steps,
    /// Whether each case has files of its own.
    many: bool,
}

impl Records {
    /// From the options, for one case or for many.
    pub fn new(args: &RecordArgs, many: bool) -> Result<Self> {
        let history = args.history.clone().map(|path| history_format(&path).map(|format| (path, format)));
        let wake = args.wake.clone();
        if let Some(path) = &wake {
            endings::of("--wake", path, &[("json", ())])?;
        }
        let vtk = args.vtk.clone();
        let steps = match &args.wake_steps {
            Some(_) if wake.is_none() && vtk.is_none() => {
                return Err(refused("--wake-steps says which steps --wake FILE.json or --vtk DIR writes: give one"));
            }
            Some(steps) => steps.clone(),
            None if vtk.is_some() => Steps::every(1),
            None if wake.is_some() => Steps::last(),
            None => Steps::none(),
        };
        Ok(Self { history: history.transpose()?, wake, vtk, steps, many })
    }

    /// Flies and writes what is to be recorded.
    pub fn fly(&self, simulation: &Simulation, case: &str) -> Result<Result<Means, Infeasible>> {
        if self.history.is_none() && self.wake.is_none() && self.vtk.is_none() {
            return Ok(manduca_numerics::simulation::simulate(simulation));
        }
        let (flown, recorder) = record(simulation, &self.steps).map_err(explained)?;
        let infeasible = flown.as_ref().err().map(ToString::to_string);
        if let Some((path, format)) = &self.history {
            let history = history(simulation, &recorder, infeasible.clone());
            self.write(path, case, |file| write_history(&history, *format, file))?;
        }
        if let Some(path) = &self.wake {
            let wake = wake(simulation, &recorder, infeasible);
            self.write(path, case, |file| write_json(&wake, file))?;
        }
        if let Some(folder) = &self.vtk {
            let folder = if self.many { folder.join(case) } else { folder.clone() };
            let steps: Vec<_> = recorder.wakes.iter().map(WakeStep::from).collect();
            let path =
                vtk::write(&folder, &steps).with_context(|| format!("cannot write into {}", folder.display()))?;
            note(format_args!("wrote {} of {} steps", path.display(), steps.len()));
        }
        Ok(flown)
    }

    fn write(&self, path: &Path, case: &str, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
        let path = if self.many { beside(path, case) } else { path.to_owned() };
        let told = || format!("cannot write {}", path.display());
        let mut draft = Draft::begin(&path).with_context(told)?;
        fill(&mut draft).and_then(|()| draft.finish()).with_context(told)?;
        note(format_args!("wrote {}", path.display()));
        Ok(())
    }
}

fn explained(error: StepsError) -> anyhow::Error {
    refused(format!("--wake-steps: {error}"))
}

fn history_format(path: &Path) -> Result<Format> {
    let known = [("csv", Format::Csv), ("ndjson", Format::NdJson), ("jsonl", Format::NdJson), ("json", Format::Json)];
    endings::of("--history", path, &known)
}

/// `folder/name.csv` for a case: `folder/name-case.csv`.
fn beside(path: &Path, case: &str) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{stem}-{case}.{}", path.extension().unwrap_or_default().to_string_lossy()))
}

fn history(simulation: &Simulation, recorder: &Recorder, infeasible: Option<String>) -> History {
    let dropped = match &simulation.model {
        Model::Uvlm(settings) => settings.strokes_dropped,
        Model::QuasiSteady(_) => 0,
    };
    History {
        parameters: ParameterValues(simulation.parameters),
        strokes_dropped: u32::try_from(dropped).unwrap_or(u32::MAX),
        solver_version: SOLVER_VERSION.into(),
        infeasible,
        rows: recorder.history.iter().map(HistoryRow::from).collect(),
    }
}

fn wake(simulation: &Simulation, recorder: &Recorder, infeasible: Option<String>) -> WakeHistory {
    WakeHistory {
        axes: AXES.into(),
        side: SIDE.into(),
        circulation: SENSE.into(),
        parameters: ParameterValues(simulation.parameters),
        solver_version: SOLVER_VERSION.into(),
        infeasible,
        steps: recorder.wakes.iter().map(WakeStep::from).collect(),
    }
}

fn write_json(value: &impl Serialize, file: &mut dyn Write) -> io::Result<()> {
    serde_json::to_writer(&mut *file, value)?;
    writeln!(file)
}

fn write_history(history: &History, format: Format, file: &mut dyn Write) -> io::Result<()> {
    match format {
        Format::Json => write_json(history, file),
        Format::NdJson => history.rows.iter().try_for_each(|row| write_json(row, file)),
        Format::Csv => {
            writeln!(file, "{}", HistoryRow::COLUMNS.join(","))?;
            history.rows.iter().try_for_each(|row| writeln!(file, "{}", row.cells().join(",")))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_of_many_cases_has_a_file_of_its_own() {
        assert_eq!(beside(Path::new("a/b.c/h.csv"), "optimum-1"), Path::new("a/b.c/h-optimum-1.csv"));
        assert_eq!(beside(Path::new("h.json"), "reference"), Path::new("h-reference.json"));
    }

    #[test]
    fn the_name_of_a_file_says_how_it_is_written() {
        let format = |name: &str| history_format(Path::new(name));
        assert_eq!(format("a.CSV").unwrap(), Format::Csv);
        assert_eq!(format("a.ndjson").unwrap(), Format::NdJson);
        assert_eq!(format("a.json").unwrap(), Format::Json);
        for name in ["a", "csv", "a.xlsx", "a.csv.gz"] {
            assert!(format(name).unwrap_err().to_string().contains(".csv, .ndjson, .jsonl or .json"), "{name}");
        }
    }
}
