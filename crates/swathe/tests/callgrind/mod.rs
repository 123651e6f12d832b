//! Counts of instructions, which are steady on any machine.

use std::process::Command;

/// Instructions that the ignored test `job` of this test program takes within the functions of a name, by valgrind's callgrind;
/// the variable tells it what to do. `None` without valgrind, where that is not required.
pub fn instructions(function: &str, variable: &str, job: &str) -> Option<f64> {
    let program = std::env::current_exe().unwrap();
    let toggle = format!("--toggle-collect=*{function}*");
    let run = Command::new("valgrind")
        .args(["--tool=callgrind", "--callgrind-out-file=/dev/null", &toggle])
        .arg(program)
        .args(["job", "--exact", "--ignored", "--nocapture", "--test-threads=1"])
        .env(variable, job)
        .output();
    let Ok(run) = run else {
        let required = std::env::var("SWATHE_REQUIRE").unwrap_or_default();
        assert!(
            !required.split(',').any(|name| name == "all" || name == "valgrind"),
            "valgrind is required and not installed"
        );
        eprintln!("valgrind is not installed: instructions are not counted");
        return None;
    };
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(run.status.success(), "{said}");
    let line = said.lines().find_map(|line| line.split("Collected : ").nth(1));
    let count = line
        .unwrap_or_else(|| panic!("no count in {said}"))
        .trim()
        .parse()
        .unwrap();
    Some(count)
}
