//! `manduca insects` and `manduca settings`.

use std::collections::BTreeMap;
use std::process::ExitCode;

use anyhow::Result;
use manduca_numerics::insect::{Insect, PRESETS};
use manduca_numerics::table::{Field, Table};
use manduca_numerics::{quasi_steady, uvlm};
use serde_json::json;

use crate::args::{InsectsArgs, Model, SettingsArgs};
use crate::exit::refused;
use crate::output::Output;

/// The presets, or one of them as a table for a study file.
pub fn insects(args: &InsectsArgs) -> Result<ExitCode> {
    let mut out = Output::stdout();
    if args.json {
        let wanted: Vec<_> = PRESETS.into_iter().filter(|p| args.name.as_deref().is_none_or(|n| n == *p)).collect();
        if wanted.is_empty() {
            preset(&mut out, args.name.as_deref().unwrap_or_default())?;
        }
        let numbers = |name: &str| -> BTreeMap<_, _> { Insect::preset(name).unwrap_or_default().entries().collect() };
        out.json(&json!({ "insects": wanted.into_iter().map(|p| (p, numbers(p))).collect::<BTreeMap<_, _>>() }))?;
        return Ok(ExitCode::SUCCESS);
    }
    match &args.name {
        Some(name) => preset(&mut out, name)?,
        None => {
            for name in PRESETS {
                let Some(insect) = Insect::preset(name) else { continue };
                let (mass, length) = (insect.mass_kg * 1e6, insect.wing_length_m * 1e3);
                out.line(format_args!("{name:12} {mass:.1} mg, wings of {length:.1} mm"))?;
            }
            out.line("\n`manduca insects NAME` prints one in full.")?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn preset(out: &mut Output, name: &str) -> Result<()> {
    let insect = Insect::preset(name)
        .ok_or_else(|| refused(format!("there is no preset `{name}`; there are {}", PRESETS.join(", "))))?;
    out.line(format_args!("# The preset `{name}`. Keep the lines you change; the others come from the preset."))?;
    out.line(format_args!("[model]\ninsect = \"{name}\"\n\n[model.insect_changes]"))?;
    for (field, (name, value)) in Insect::FIELDS.iter().zip(insect.entries()) {
        out.line(format_args!("{:45} # {}{}", format!("{name} = {}", toml_number(value)), unit(field), field.meaning))?;
    }
    Ok(())
}

/// TOML tells a float by its point or exponent; either kind is read as a number here.
fn toml_number(value: f64) -> String {
    if value != 0.0 && value.abs() < 1e-3 { format!("{value:e}") } else { value.to_string() }
}

fn unit(field: &Field) -> String {
    if field.unit.is_empty() { String::new() } else { format!("[{}] ", field.unit) }
}

/// The settings of a solver.
pub fn settings(args: &SettingsArgs) -> Result<ExitCode> {
    let fields = match args.model {
        Model::Uvlm => uvlm::Settings::FIELDS,
        Model::QuasiSteady => quasi_steady::Settings::FIELDS,
    };
    let row = |f: &Field| {
        let whole = if f.whole { " (whole)" } else { "" };
        let range = format!("{} to {}{whole}", f.min, f.max);
        [f.name.to_owned(), f.default.to_string(), range, f.unit.to_owned(), f.meaning.to_owned()].to_vec()
    };
    let mut out = Output::stdout();
    if args.json {
        let object = |f: &Field| {
            json!({ "name": f.name, "default": f.default, "min": f.min, "max": f.max, "whole": f.whole,
                    "unit": f.unit, "meaning": f.meaning })
        };
        out.json(&json!({ "settings": fields.iter().map(object).collect::<Vec<_>>() }))?;
        return Ok(ExitCode::SUCCESS);
    }
    let header = ["setting", "default", "range", "unit", "meaning"].map(String::from);
    out.table(&header, &fields.iter().map(row).collect::<Vec<_>>())?;
    out.line("Study files take them in [model.solver], `manduca simulate` as options (--steps-per-stroke 96).")?;
    Ok(ExitCode::SUCCESS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::capture;
    use manduca_protocol::resolve;
    use manduca_protocol::study::ModelSpec;
    use serde::Deserialize;

    #[test]
    fn a_printed_preset_is_a_study_files_table() {
        #[derive(Deserialize)]
        struct File {
            model: ModelSpec,
        }
        for name in PRESETS {
            let (mut out, captured) = capture::output();
            preset(&mut out, name).unwrap();
            let file: File = toml::from_str(&captured.text()).unwrap();
            assert_eq!(file.model.insect_changes.len(), Insect::FIELDS.len());
            assert_eq!(resolve::model(&file.model, "/model").unwrap().insect, Insect::preset(name).unwrap());
        }
        let (mut out, _) = capture::output();
        assert!(preset(&mut out, "dragon").unwrap_err().to_string().contains("hawkmoth"));
    }
}
