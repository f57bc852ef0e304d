//! The house rules that a compiler does not check: imports run one way, and what may only live in one room.

use std::fs;
use std::path::{Path, PathBuf};

/// Each room with the rooms that it may import from.
const ALLOWED: [(&str, &[&str]); 7] = [
    ("physics", &["error", "physics"]),
    ("scene", &["error", "physics", "scene"]),
    ("plan", &["error", "physics", "scene", "plan"]),
    ("tally", &["tally"]),
    ("result", &["result"]),
    ("backend", &["error", "physics", "scene", "plan", "tally", "result", "backend"]),
    ("python", &["error", "physics", "scene", "plan", "result", "backend", "python"]),
];

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).expect("the source folder is there") {
        let path = entry.expect("its entries can be read").path();
        if path.is_dir() {
            found.extend(files(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
    found
}

/// (room, path, text without its tests) of every source file.
fn sources() -> Vec<(String, PathBuf, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    files(&root)
        .into_iter()
        .map(|path| {
            let first = path.strip_prefix(&root).expect("it lies in src").iter().next().expect("it has a name");
            let room = first.to_string_lossy().trim_end_matches(".rs").to_string();
            let text = fs::read_to_string(&path).expect("it can be read");
            let text = text.split("#[cfg(test)]").next().unwrap_or_default().to_string();
            (room, path, text)
        })
        .collect()
}

#[test]
fn imports_run_one_way() {
    let mut checked = 0;
    for (room, path, text) in sources() {
        let Some((_, allowed)) = ALLOWED.iter().find(|(name, _)| *name == room) else { continue };
        for part in text.split("crate::").skip(1) {
            let name: String = part.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
            assert!(allowed.contains(&name.as_str()), "{} imports crate::{name}", path.display());
            checked += 1;
        }
    }
    assert!(checked > 50, "only {checked} imports were found");
}

#[test]
fn python_and_unsafe_stay_in_their_rooms() {
    for (_, path, text) in sources() {
        let homes =
            [("pyo3", "src/python"), ("numpy", "src/python"), ("wgpu", "backend/gpu"), ("unsafe ", "cpu/simd.rs")];
        for (word, home) in homes {
            let code: String = text.lines().filter(|l| !l.trim_start().starts_with("//")).collect();
            let at_home = path.to_string_lossy().contains(home);
            assert!(at_home || !code.contains(word), "{word} in {}", path.display());
        }
    }
}
