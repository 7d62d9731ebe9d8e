//! The `gradreel` command.

fn main() -> std::process::ExitCode {
    gradreel_models::cli::main().into()
}
