#include "experiments/command/cli.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>

#include <palpate/result.h>
#include "experiments/command/subcommands.h"
#include "experiments/driver/suite.h"
#include "experiments/report/tables.h"
#include "experiments/session/session.h"
#include "experiments/session/version.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

using Words = std::vector<std::string>;

// ---- former names: they work for one version more

struct Former {
  const char *old, *now;
  const char *old_option = "", *option = "";  ///< that has another name now
  Words added = {};                           ///< where the first of them is not given
  bool alone = false;                         ///< with nothing but --json behind it
};

const std::vector<Former>& former() {
  static const std::vector<Former> all = {
      {"plan", "info plan"},
      {"renderers", "list renderers"},
      {"paths", "list paths"},
      {"devices", "list devices"},
      {.old = "fetch", .now = "list scans", .alone = true},
      {.old = "clean", .now = "list steps", .alone = true},
      {"replay", "compare", "--renderer", "--renderers", {"--renderers", "auto"}},
      {"sweep", "compare sweep"},
      {"merge", "compare merge"},
      {"ablate", "compare ablate"},
      {"behaviours", "test behaviours"},
      {"stress", "test stress"},
      {"hunt", "test hunt"},
      {"stability", "test stability", "--hand", "--grip"},
      {"goals", "test goals"},
      {"record", "live record", "--hand", "--grip"},
      {"bridge", "live serve", "--hand", "--grip"},
      {"score", "report score"},
      {"export", "report export"}};
  return all;
}

/// `option` itself or with a value behind =.
bool is_option(const std::string& word, const std::string& option) {
  return word == option || word.starts_with(option + "=");
}

bool gives(const Words& words, const std::string& option) {
  return std::any_of(words.begin(), words.end(),
                     [&](const std::string& word) { return is_option(word, option); });
}

/// The value of an option, which is taken out of the words; empty where it is not given.
std::string taken(Words& words, const std::string& option) {
  for (auto word = words.begin(); word != words.end(); ++word) {
    const bool next = *word == option && word + 1 != words.end();
    if (!next && !word->starts_with(option + "=")) continue;
    const std::string value = next ? word[1] : word->substr(option.size() + 1);
    words.erase(word, word + (next ? 2 : 1));
    return value;
  }
  return {};
}

/// The same of options that are no longer there.
std::string renew_options(Words& words) {
  if (std::erase(words, "--headless") > 0) return "--headless is gone: without --window there is none";
  // Without both, the words stay as they are and are refused as any others.
  if (!gives(words, "--traj-columns") || !gives(words, "--path")) return {};
  std::string columns = taken(words, "--traj-columns");
  std::replace(columns.begin(), columns.end(), ',', ':');
  words.insert(words.end(), {"--path", taken(words, "--path") + ":" + columns});
  return fmt::format("--traj-columns is now part of the path: --path {}", words.back());
}

/// Today's words for those of the former version. Returns the changes; empty: none.
std::string renew(Words& words) {
  const auto others = [&] {
    return std::any_of(words.begin() + 1, words.end(), [](const std::string& w) { return w != "--json"; });
  };
  for (const Former& name : former()) {
    if (words.front() != name.old || (name.alone && others())) continue;
    const std::string old = name.old_option;
    for (std::string& word : words)
      if (!old.empty() && is_option(word, old)) word = name.option + word.substr(old.size());
    if (!name.added.empty() && !gives(words, name.added.front()) && !gives(words, "--help"))
      words.insert(words.end(), name.added.begin(), name.added.end());
    const std::string now = name.now;
    const std::size_t blank = now.find(' ');
    words.front() = now.substr(0, blank);
    if (blank != std::string::npos) words.insert(words.begin() + 1, now.substr(blank + 1));
    return fmt::format("`palpate {}` is now `palpate {}`; the old name works for one version more", name.old,
                       name.now);
  }
  return {};
}

/// Options that choose a kind: `info SCENE --plan` is `info plan SCENE`, and `compare SCENE --vary AXES` is
/// `compare sweep SCENE --axes AXES`.
void choose_kind(Words& words) {
  if (words.front() == "info" && std::erase(words, "--plan") > 0) words.insert(words.begin() + 1, "plan");
  if (words.front() != "compare") return;
  const std::string axes = taken(words, "--vary");
  if (axes.empty()) return;
  if (words.size() == 1 || words[1] != "sweep") words.insert(words.begin() + 1, "sweep");
  words.insert(words.end(), {"--axes", axes});
}

// ---- help, completion

std::vector<Subcommand> kinds_of(const std::string& verb) {
  std::vector<Subcommand> kinds = all_subcommands();
  std::erase_if(kinds, [&](const Subcommand& kind) { return !kind.name.starts_with(verb + " "); });
  return kinds;
}

Words kind_names(const std::string& verb) {
  Words names;
  for (const Subcommand& kind : kinds_of(verb)) names.push_back(kind.name.substr(verb.size() + 1));
  return names;
}

Words verb_names() {
  Words names;
  for (const Verb& verb : kVerbs) names.emplace_back(verb.name);
  return names;
}

std::string program_help() {
  std::string text =
      "Haptic rendering of dense point clouds, and the bench that compares it with mesh baselines.\n\n"
      "  palpate compare scan.ply --unit m\n"
      "  palpate live scan.ply --unit m --window\n\n";
  for (const Verb& verb : kVerbs) text += fmt::format("{:<9}{:<11}{}\n", verb.group, verb.name, verb.summary);
  return text +
         "\n`palpate VERB --help` and `palpate VERB KIND --help` show examples and options; `palpate "
         "--version`.\nExit status: 0 done; 1 ran, and failed or fell short; 2 bad arguments or input; 130 "
         "interrupted,\n143 terminated: what is complete is kept, and the same command resumes there.\n";
}

std::string verb_help(const std::string& verb, bool all) {
  std::string text;
  for (const Verb& one : kVerbs)
    if (one.name == verb) text = fmt::format("{}\n\npalpate {} KIND\n\n", one.summary, verb);
  for (const Subcommand& kind : kinds_of(verb)) {
    text += joined(wrapped(kind.name + ": " + kind.summary, kHelpColumns), "\n") + "\n";
    for (std::size_t i = 0; i < (all ? kind.examples.size() : 1); ++i) text += "  " + kind.examples[i] + "\n";
  }
  return text;
}

/// For bash: verbs, kinds and every option; files where none of them fits.
std::string completion() {
  std::string cases;
  const auto add = [&](const std::string& name, const std::string& pattern, const Words& more) {
    Words offered = more;
    for (const Subcommand& one : all_subcommands())
      if (one.name == name)
        for (std::string& option : option_names(*declare(one).app)) offered.push_back(std::move(option));
    cases += fmt::format("      {}) words='{} --help --help-all' ;;\n", pattern, joined(offered, " "));
  };
  for (const std::string& verb : verb_names()) {
    for (const Subcommand& kind : kinds_of(verb)) add(kind.name, "'" + kind.name + "'", {});
    add(verb, "'" + verb + " '*", kind_names(verb));
  }
  return fmt::format(
      "# bash completion of palpate\n_palpate() {{\n  local words='{} --help --version'\n"
      "  if ((COMP_CWORD > 1)); then\n    case \"${{COMP_WORDS[1]}} ${{COMP_WORDS[2]}}\" in\n{}"
      "      *) words= ;;\n    esac\n  fi\n"
      "  COMPREPLY=($(compgen -W \"$words\" -- \"${{COMP_WORDS[COMP_CWORD]}}\"))\n}}\n"
      "complete -o default -F _palpate palpate\n",
      joined(verb_names(), " "), cases);
}

/// The page of the manual: every help text as it stands.
std::string manual() {
  std::string text = program_help();
  for (const Subcommand& one : all_subcommands())
    text += "\n\n" + one.name + "\n\n" + help_text(one, true, {});
  std::string page = ".TH PALPATE 1 \"\" \"palpate " + std::string(version_text()) +
                     "\"\n.SH NAME\npalpate \\- haptic rendering of dense point clouds\n.SH COMMANDS\n.nf\n";
  for (std::size_t i = 0; i < text.size(); ++i) {
    if ((text[i] == '.' || text[i] == '\'') && (i == 0 || text[i - 1] == '\n')) page += "\\&";
    page += text[i] == '\\' ? "\\e" : text[i] == '-' ? "\\-" : std::string(1, text[i]);
  }
  return page + ".fi\n";
}

/// Answers that need no subcommand; empty: the words name one.
std::string answer_of(const Words& words) {
  const std::string& first = words.front();
  if (first == "--help" || first == "-h" || first == "--help-all") return program_help();
  if (first == "--version")
    return fmt::format("palpate {} (commit {}, {})\n", version_text(), kCommit, build_text());
  if (words == Words{"completion", "bash"}) return completion();
  if (words == Words{"completion", "man"}) return manual();
  return {};
}

/// The subcommand that the words begin with, without these words; the name alone where the verb has kinds
/// only.
Result<Subcommand> take_subcommand(Words& words) {
  const std::string verb = words.front();
  const std::string pair = words.size() > 1 ? verb + " " + words[1] : verb;
  Subcommand named{verb, {}, {}, {}};
  for (const Subcommand& one : all_subcommands())
    if (one.name == pair || (one.name == verb && named.name == verb)) named = one;
  if (named.declare || !kinds_of(verb).empty()) {
    words.erase(words.begin(),
                words.begin() + (named.name == pair && words.size() > 1 && pair != verb ? 2 : 1));
    return named;
  }
  const std::string near = nearest_name(verb, verb_names());
  return Error{fmt::format("there is no command '{}'", verb),
               (near.empty() ? "" : "did you mean '" + near + "'? ") + "`palpate --help` lists them"};
}

bool asks_for_help(const Words& words, bool& all) {
  for (const std::string& word : words) {
    if (word == "--") return false;
    all = word == "--help-all";
    if (all || word == "--help" || word == "-h") return true;
  }
  return false;
}

/// The cases that are measured here, by --emit, --engine and --case.
CaseSelection selection_of(const CLI::App& app, Words words) {
  const auto given = [&](const char* name) {
    const CLI::Option* option = app.get_option_no_throw(name);
    return option != nullptr && option->count() > 0 ? option->as<std::string>() : std::string();
  };
  CaseSelection cases;
  cases.run = !given(kEngineOption).empty();
  cases.list = cases.run || !given(kEmitOption).empty();
  cases.only = given(kCaseOption);
  for (const char* option : {kEngineOption, kEmitOption}) (void)taken(words, option);
  std::error_code code;
  words.insert(words.begin(), std::filesystem::read_symlink("/proc/self/exe", code).string());
  for (const std::string& word : words) cases.command += (cases.command.empty() ? "" : " ") + for_shell(word);
  return cases;
}

}  // namespace

std::vector<std::pair<std::string, std::string>> former_names() {
  std::vector<std::pair<std::string, std::string>> names;
  for (const Former& name : former()) names.emplace_back(name.old, name.now);
  return names;
}

Result<ReadLine> read_line(Words words) {
  ReadLine line;
  if (words.empty()) return Error{"a command is missing", "`palpate --help` lists them"};
  line.answer = answer_of(words);
  if (!line.answer.empty()) return line;
  if (words.front().starts_with("-"))
    return Error{
        "unknown option " + shown(words.front()),
        did_you_mean(words.front(), {"--help", "--version"}, "`palpate --help` shows what is understood")};
  const std::string option_note = renew_options(words);
  line.note = renew(words);
  line.note += (line.note.empty() || option_note.empty() ? "" : "; ") + option_note;
  choose_kind(words);
  PALPATE_ASSIGN(const Subcommand named, take_subcommand(words));
  line.name = named.name;
  bool all = false;
  const bool help = asks_for_help(words, all);
  if (!named.declare && !help)
    return Error{fmt::format("palpate {} needs one of {}", named.name, joined(kind_names(named.name))),
                 did_you_mean(words.empty() ? "" : words.front(), kind_names(named.name),
                              fmt::format("`palpate {} --help` shows them", named.name))};
  if (help) {
    line.answer = named.declare ? help_text(named, all, kinds_of(named.name)) : verb_help(named.name, all);
    return line;
  }
  const std::string remedy = fmt::format("`palpate {} --help` shows what is understood", named.name);
  line.command = declare(named);
  // Before the rest, or what is missing because of it would be named in its stead.
  if (std::optional<Error> unknown = unknown_option(*line.command.app, words)) {
    unknown->remedy += (unknown->remedy.empty() ? "" : " ") + remedy;
    return *std::move(unknown);
  }
  try {
    std::reverse(words.begin(), words.end());
    line.command.app->parse(std::move(words));
  } catch (const CLI::ParseError& error) {
    return Error{error.what(), remedy};
  }
  return line;
}

int run_command_line(int argc, const char* const* argv) {
  const Result<ReadLine> line = read_line({argv + std::min(argc, 1), argv + argc});
  if (!line) return fail(line.error(), kExitBadInput);
  if (!line->note.empty()) tell("palpate: note: {}\n", line->note);
  if (!line->answer.empty()) {
    fmt::print("{}", line->answer);
    return kExitOk;
  }
  ProgressBar progress;
  Context context{progress, "palpate"};
  for (int i = 1; i < argc; ++i) context.command_line += " " + for_shell(argv[i]);
  const CLI::Option* verbose = line->command.app->get_option_no_throw("--verbose");
  context.verbose = verbose != nullptr && verbose->count() > 0;
  context.cases = selection_of(*line->command.app, {argv + 1, argv + argc});
  const int status = line->command.run(context);
  const CaseSelection& cases = context.cases;
  return cases.run && status == kExitOk ? fail(run_jobs(cases.written), kExitBadInput) : status;
}

}  // namespace palpate::experiments
