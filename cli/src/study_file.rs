//! Studies as files: found, read, checked.

use std::path::Path;

use anyhow::Result;
use manduca_protocol::problem::FieldProblem;
use manduca_protocol::study::StudySpec;
use manduca_protocol::{resolve, strict};
use serde_path_to_error::{Path as FieldPath, Segment};

use crate::exit::refused;
use crate::text_file;

/// Studies which are part of the program, so that it works anywhere.
pub const BUILT_IN: [(&str, &str); 5] = [
    ("quick", include_str!("../../studies/quick.toml")),
    ("paper", include_str!("../../studies/paper.toml")),
    ("five", include_str!("../../studies/five.toml")),
    ("five-direct", include_str!("../../studies/five-direct.toml")),
    ("truth", include_str!("../../studies/truth.toml")),
];

/// Reads and checks a study: a file, or one of those built in.
pub fn load(name: &str) -> Result<StudySpec> {
    let path = Path::new(name);
    let built_in = BUILT_IN.iter().find(|(built_in, _)| *built_in == name);
    let text = if let Some((_, text)) = built_in.filter(|_| !path.exists() || path.is_dir()) {
        // A folder of that name is where an earlier run put its data.
        (*text).to_owned()
    } else if path.exists() {
        text_file::read(path)?
    } else {
        let known: Vec<_> = BUILT_IN.iter().map(|(name, _)| *name).collect();
        return Err(refused(format!(
            "{name}: no such file, and no built-in study of that name ({})",
            known.join(", ")
        )));
    };
    let spec = if text_file::is_json(path, &text) { from_json(&text) } else { from_toml(&text) };
    let spec = spec.map_err(|fault| refused(format!("{name}{fault}")))?;
    let mut faults = resolve::texts(&spec);
    faults.extend(resolve::study(&spec).err().unwrap_or_default());
    if faults.is_empty() { Ok(spec) } else { Err(refused(listed(name, &faults))) }
}

/// Faults, one a line, each with the file it is in.
pub fn listed(name: &str, faults: &[FieldProblem]) -> String {
    faults.iter().map(|fault| format!("{name}: {fault}")).collect::<Vec<_>>().join("\n       ")
}

/// What follows the file's name in an error: `:line: /field: reason`.
fn from_toml(text: &str) -> Result<StudySpec, String> {
    let at_line = |error: &toml::de::Error| {
        let before = error.span().and_then(|span| text.get(..span.start));
        before.map_or_else(String::new, |before| format!(":{}", before.matches('\n').count() + 1))
    };
    let document = toml::de::Deserializer::parse(text).map_err(|e| format!("{}: {}", at_line(&e), e.message()))?;
    serde_path_to_error::deserialize(document).map_err(|e| {
        let problem = FieldProblem::new(pointer(e.path()), e.inner().message());
        format!("{}: {problem}", at_line(e.inner()))
    })
}

fn from_json(text: &str) -> Result<StudySpec, String> {
    let mut document = serde_json::Deserializer::from_str(text);
    let mut track = serde_path_to_error::Track::new();
    let tracked = serde_path_to_error::Deserializer::new(&mut document, &mut track);
    let spec = strict::object(tracked).map_err(|e| {
        // The message of serde_json ends with line and column; the field says more, so it comes first.
        format!(": {}", FieldProblem::new(pointer(&track.path()), e.to_string()))
    })?;
    document.end().map_err(|e| format!(": {e}"))?;
    Ok(spec)
}

fn pointer(path: &FieldPath) -> String {
    let mut pointer = String::new();
    for segment in path {
        match segment {
            Segment::Seq { index } => pointer += &format!("/{index}"),
            Segment::Map { key } => pointer += &format!("/{}", key.replace('~', "~0").replace('/', "~1")),
            Segment::Enum { .. } | Segment::Unknown => {}
        }
    }
    pointer
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn faults(text: &str) -> String {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("bad.toml");
        fs::write(&path, text).unwrap();
        format!("{:#}", load(path.to_str().unwrap()).unwrap_err())
    }

    #[test]
    fn the_built_in_studies_are_accepted() {
        for (name, _) in BUILT_IN {
            let spec = load(name).unwrap();
            assert_eq!(spec.name, name);
            assert_eq!(spec.optimisations.is_empty(), name == "truth");
        }
    }

    #[test]
    fn a_study_may_have_a_byte_order_mark_and_comes_from_a_pipe_too() {
        let dir = tempfile::tempdir().unwrap();
        for (name, text) in
            [("a.json", include_str!("../../studies/quick.json")), ("a.toml", BUILT_IN[0].1), ("63", BUILT_IN[0].1)]
        {
            let path = dir.path().join(name);
            fs::write(&path, format!("\u{feff}{text}")).unwrap();
            assert_eq!(load(path.to_str().unwrap()).unwrap(), load("quick").unwrap(), "{name}");
        }
        let told = load(dir.path().to_str().unwrap()).unwrap_err();
        assert!(told.to_string().contains("is a folder") && told.is::<crate::exit::Refused>());
    }

    #[test]
    fn toml_and_json_say_the_same() {
        let json = from_json(include_str!("../../studies/quick.json")).unwrap();
        assert_eq!(json, load("quick").unwrap());
    }

    #[test]
    fn the_papers_study_has_the_papers_numbers() {
        let spec = load("paper").unwrap();
        let resolved = resolve::study(&spec).unwrap();
        assert_eq!((spec.sampling.samples, spec.surrogate.neurons), (5000, 500));
        assert_eq!(resolved.bounds, manduca_numerics::parameters::Bounds::default());
        let held = |i: usize| (0..10).filter(|&p| resolved.optimisations[i].bounds.is_held(p)).collect::<Vec<_>>();
        assert_eq!((held(0), held(1)), (vec![], vec![1, 3, 6]));
    }

    #[test]
    fn both_studies_of_five_parameters_ask_the_same() {
        let resolved = |name: &str| resolve::study(&load(name).unwrap()).unwrap();
        let (surrogate, direct) = (resolved("five"), resolved("five-direct"));
        assert_eq!((surrogate.bounds, surrogate.model), (direct.bounds, direct.model));
        let free: Vec<_> = (0..10).filter(|&p| !direct.bounds.is_held(p)).collect();
        assert_eq!(free, [0, 2, 4, 5, 7]);
        // Population 300, 50 generations, 5 % survive.
        assert_eq!((direct.optimisations[0].individuals(), surrogate.optimisations[0].individuals()), (14265, 0));
    }

    #[test]
    fn a_fault_names_file_field_and_reason() {
        let text = faults("name = \"x\"\n[sampling]\nsamples = 3\n");
        assert!(text.contains("bad.toml: /sampling/samples: 3 is outside 20 to 200000"), "{text}");
        let text = faults("name = \"x\"\n[sampling]\nsamples = \"many\"\n");
        assert!(text.contains("bad.toml:3: /sampling/samples: invalid type: string"), "{text}");
        let text = faults("name = \"x\"\n[sampling]\nsamples = 100\n[model]\nkindd = \"uvlm\"\n");
        assert!(text.contains("/model") && text.contains("unknown field `kindd`"), "{text}");
        let text = faults("name = \"x\"\n[sampling]\nsamples = 100\n[parameters]\nfrequency_hz = [1]\n");
        assert!(text.contains("/parameters/frequency_hz") && text.contains("[low, high]"), "{text}");
        let text = faults("name = \"x\"\nname = \"y\"\n");
        assert!(text.contains("bad.toml:2: "), "{text}");
    }

    #[test]
    fn json_is_read_as_strictly_as_toml() {
        for (text, told) in [
            (r#"["a", "", 1, {}, {}, {"samples": 30}, {}, []]"#, "/: invalid type: sequence, expected an object"),
            (r#"{"name": "a", "sampling": [30, 0]}"#, "/sampling: invalid type: sequence, expected an object"),
            (r#"{"name": "a", "sampling": {"samples": 30, "samples": 40}}"#, "/sampling: duplicate field `samples`"),
            (r#"{"name": "a", "sampling": {"samples": 30}} {}"#, "trailing characters"),
        ] {
            let fault = from_json(text).unwrap_err();
            assert!(fault.contains(told), "{text}: {fault}");
        }
    }

    #[test]
    fn every_fault_is_told_at_once() {
        let text = faults("name = \"\"\n[sampling]\nsamples = 3\n[model.solver]\nstrokes = 2.5\nwings = 4\n");
        for field in ["/name", "/sampling/samples", "/model/solver/strokes", "/model/solver/wings"] {
            assert!(text.contains(field), "{field} in {text}");
        }
    }

    #[test]
    fn an_unknown_name_lists_those_there_are() {
        let text = load("fast").unwrap_err().to_string();
        assert!(text.contains("quick") && text.contains("paper"), "{text}");
    }
}
