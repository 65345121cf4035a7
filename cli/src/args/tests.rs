use super::*;
use clap::CommandFactory;

fn parse(line: &str) -> Result<Cli, clap::Error> {
    Cli::try_parse_from(line.split_whitespace())
}

#[test]
fn the_definition_is_sound() {
    Cli::command().debug_assert();
}

#[test]
fn every_command_has_help_and_needs_no_options() {
    let lines = "run|serve|worker|study list|study show latest|study model latest|figures latest|completions bash|dataset latest|optimum latest|simulate|report verification|analyse sobol latest|analyse sweep latest|analyse population latest|insects|settings|slot|token list|token create x --scope worker|token revoke x|bench queue|db backup x|db check|db prune --older-than-days 1|workers list|workers drain x|explain 1|doctor";
    for line in lines.split('|') {
        assert!(parse(&format!("manduca {line}")).is_ok(), "{line}");
        let error = parse(&format!("manduca {line} --help")).unwrap_err();
        assert_eq!(error.kind(), clap::error::ErrorKind::DisplayHelp, "{line}");
    }
}

#[test]
fn solver_settings_are_options() {
    let cli =
        parse("manduca simulate --spanwise-panels 16 --wake-strokes 2.5 --set frequency-hz=30 --set K=-1").unwrap();
    let Command::Simulate(args) = cli.command else { panic!("simulate") };
    let spec = args.model.spec();
    assert_eq!(
        spec.solver.into_iter().collect::<Vec<_>>(),
        [("spanwise_panels".into(), 16.0), ("wake_strokes".into(), 2.5)]
    );
    assert_eq!(args.set, [("frequency_hz".to_owned(), 30.0), ("K".to_owned(), -1.0)]);
}

#[test]
fn reports_go_to_docs_unless_told_otherwise() {
    for (line, folder) in [("verification", "docs"), ("verification --output elsewhere", "elsewhere")] {
        let cli = parse(&format!("manduca report {line}")).unwrap();
        let Command::Report(ReportCommand::Verification(args)) = cli.command else { panic!("report") };
        assert_eq!(args.output, std::path::Path::new(folder));
    }
}

#[test]
fn every_setting_tells_its_range_and_default() {
    let mut command = Cli::command();
    let simulate = command.find_subcommand_mut("simulate").unwrap();
    let help = simulate.render_long_help().to_string();
    for text in ["--bound-core-on-wake", "[8 to 720; default: 68]", "--drag-coefficient-90"] {
        assert!(help.contains(text), "{text} in {help}");
    }
}

#[test]
fn a_heading_of_the_help_ends_with_its_options() {
    let mut command = Cli::command();
    let help = command.find_subcommand_mut("simulate").unwrap().render_help().to_string();
    let below = |heading: &str| help.split(heading).nth(1).unwrap().split("\n\n").next().unwrap().to_owned();
    assert!(below("Step by step").contains("--wake-steps") && !below("Step by step").contains("--insect"), "{help}");
    assert!(below("Options:").contains("--insect"), "{help}");
}

#[test]
fn nonsense_is_refused() {
    for line in [
        "run --slots two",
        "simulate --case dragon",
        "simulate --set frequency",
        "study submit",
        "dataset x --format xls",
        "token create x",
        "token create x --scope root",
        "serve --insecure --require-tokens",
        "serve --run-limit 0",
        "analyse front latest",
        "analyse front latest --quantity colour",
        "analyse sobol latest --csv --json",
    ] {
        assert!(parse(&format!("manduca {line}")).is_err(), "{line}");
    }
}
