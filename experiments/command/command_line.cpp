#include "experiments/command/command_line.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>

#include "experiments/command/subcommands.h"
#include "experiments/session/session.h"
#include "experiments/session/version.h"

namespace palpate::experiments {
namespace {

std::string for_shell(const std::string& argument) {
  constexpr const char* kPlain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-+=:,./@%";
  if (!argument.empty() && argument.find_first_not_of(kPlain) == std::string::npos) return argument;
  std::string text = "'";
  for (const char c : argument) text += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return text + "'";
}

constexpr const char* kWhatItIs =
    "Haptic rendering of dense point clouds, and the bench that compares it with mesh baselines.";

}  // namespace

void declare(CLI::App& app, Runs& runs) {
  app.require_subcommand(1);
  app.set_version_flag("--version",
                       fmt::format("palpate {} (commit {}, {})", version_text(), kCommit, build_text()));
  app.footer(
      "Exit status: 0 done; 1 ran, and failed or fell short; 2 bad arguments or input; 130 interrupted, and\n"
      "143 terminated, at once: what was complete is kept, and the same command goes on from there.\n"
      "`palpate COMMAND --help` shows examples.");
  declare(app, all_subcommands(), runs);
}

Status parse(CLI::App& app, int argc, const char* const* argv, bool& answered) {
  answered = false;
  const auto is_first = [&](const CLI::App* command) { return command->get_name() == argv[1]; };
  const bool named = argc > 1 && !app.get_subcommands(is_first).empty();
  if (argc > 1 && argv[1][0] != '-' && !named)
    return Error{fmt::format("there is no command '{}'", argv[1]), "`palpate --help` lists them", {}, 0};
  const std::string help =
      fmt::format("`palpate{} --help` shows what is understood", named ? std::string(" ") + argv[1] : "");
  // Before the rest, or what is missing because of it would be named in its stead.
  if (std::optional<Error> unknown = unknown_option(app, argc, argv)) {
    unknown->remedy += (unknown->remedy.empty() ? "" : " ") + help;
    return *std::move(unknown);
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    answered = error.get_exit_code() == 0;  // --help, --version
    if (answered)
      app.exit(error);
    else
      return Error{error.what(), help, {}, 0};
  }
  return Done{};
}

int run_command_line(int argc, const char* const* argv) {
  CLI::App app(kWhatItIs, "palpate");
  Runs runs;
  declare(app, runs);
  bool answered = false;
  if (const Status good = parse(app, argc, argv, answered); !good) return fail(good.error(), kExitBadInput);
  if (answered) return kExitOk;
  ProgressBar progress;
  Context context{progress, "palpate"};
  for (int i = 1; i < argc; ++i) context.command_line += " " + for_shell(argv[i]);
  return runs.at(app.get_subcommands().front()->get_name())(context);
}

}  // namespace palpate::experiments
