#include "experiments/command/cli.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <string_view>

#include "experiments/report/tables.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

constexpr const char *kShared = "shared", *kRare = "rare";

template <class T>
CLI::Option* add_read(CLI::App& command, const std::string& name, const std::function<void(T)>& take,
                      const NumberRange& range, const std::string& help,
                      Result<T> (*read)(std::string_view, const NumberRange&)) {
  CLI::Option* option = command.add_option_function<std::string>(
      name,
      [take, range, name, read](const std::string& text) {
        const Result<T> number = read(text, range);
        if (!number) throw CLI::ValidationError(name, number.error().what);
        take(*number);
      },
      help);
  return option->type_name(text_of(range));
}

/// The letter or the word behind the dashes, without a value; empty where the argument is no option.
std::string_view option_name(std::string_view argument) {
  const bool dashed = argument.size() > 1 && argument[0] == '-';
  // A minus before a digit or a point is a number's.
  const bool number = dashed && (argument[1] == '.' || (argument[1] >= '0' && argument[1] <= '9'));
  return dashed && !number ? argument.substr(0, argument.find('=')) : std::string_view();
}

Error not_known(const CLI::App& command, std::string_view name) {
  if (name == kEmitOption || name == kEngineOption)
    return Error{fmt::format("{} has no jobs for {}: it is one case, or each case needs the answer before it",
                             command.get_name(), name),
                 fmt::format("leave {} out, and run what is independent by a command each.", name)};
  std::vector<std::string> known;
  for (const CLI::Option* option : command.get_options())
    for (const std::string& word : option->get_lnames()) known.push_back(word);
  const std::string_view word = name.substr(std::min(name.size(), name.find_first_not_of('-')));
  const std::string near = nearest_name(word, known);
  return Error{"unknown option " + shown(name),
               near.empty() ? std::string() : "did you mean --" + near + "?"};
}

/// An empty text is what a script's unset variable leaves: it is no choice of the default.
std::string given_and_empty(const std::string& text) {
  return text.empty() ? "is empty; leave it out for the default, or give it a value" : "";
}

/// Words of one column, then text beside it.
std::string entry_text(const std::string& name, const std::string& says) {
  constexpr std::size_t kNames = 20;
  std::string text = "  " + name;
  if (text.size() >= kNames)
    text += "\n" + std::string(kNames, ' ');
  else
    text.resize(kNames, ' ');
  std::string between;
  for (const std::string& line : wrapped(says, kHelpColumns - kNames)) {
    text += between + line;
    between = "\n" + std::string(kNames, ' ');
  }
  return text + "\n";
}

std::string option_text(const CLI::Option& option, bool all) {
  const bool takes_value = option.get_items_expected_max() > 0 && !option.get_positional();
  std::string range = all ? option.get_type_name() : "";
  range.resize(std::min(range.size(), range.find(":{")));  // choices once, without the library's list
  if (range == "TEXT") range.clear();
  return entry_text(option.get_name() + (takes_value ? " .." : ""),
                    option.get_description() + (range.empty() ? "" : "; " + range));
}

std::string options_text(const CLI::App& command, const std::string& group, bool all) {
  std::string text;
  for (const bool positional : {true, false})  // whatever is declared first
    for (const CLI::Option* option : command.get_options())
      if (option->get_group() == group && option->get_positional() == positional)
        text += option_text(*option, all);
  return text;
}

}  // namespace

void Declaration::text(const std::string& name, std::string& value, const std::string& help) const {
  placed(command_.add_option(name, value, help))->check(given_and_empty);
}

void Declaration::required(const std::string& name, std::string& value, const std::string& help) const {
  placed(command_.add_option(name, value, help))->required()->check(given_and_empty);
}

void Declaration::several(const std::string& name, std::vector<std::string>& values,
                          const std::string& help) const {
  placed(command_.add_option(name, values, help))->required()->check(given_and_empty);
}

void Declaration::repeated(const std::string& name, std::vector<std::string>& values,
                           const std::string& help) const {
  placed(command_.add_option(name, values, help))->allow_extra_args(false)->check(given_and_empty);
}

void Declaration::choice(const std::string& name, std::string& value, const std::vector<std::string>& choices,
                         const std::string& help) const {
  placed(command_.add_option(name, value, help))
      ->check(CLI::IsMember(choices))
      ->type_name(joined(choices, "|"));
}

void Declaration::flag(const std::string& name, bool& value, const std::string& help) const {
  placed(command_.add_flag(name, value, help));
}

void Declaration::verbose() const {
  const std::string help = "print every table, not only the first lines";
  shared().placed(command_.add_flag("--verbose", help));
}

void Declaration::cases() const {
  const auto add = [&](const char* name, const std::string& help) {
    return command_.add_option_function<std::string>(
        name, [](const std::string&) {}, help);
  };
  for (const auto& [name, help] :
       {std::pair{kEmitOption, "snakemake: only write jobs, one per case, into the folder's jobs"},
        {kEngineOption, "snakemake: write the jobs and run them here"}})
    shared().placed(add(name, help))->check(CLI::IsMember({"snakemake"}));
  add(kCaseOption, "what a job measures")->group("")->check(given_and_empty);
  excludes(kEmitOption, kEngineOption);
  for (const char* name : {kEmitOption, kEngineOption}) excludes(kCaseOption, name);
}

void Declaration::number(const std::string& name, double& value, const NumberRange& range,
                         const std::string& help) const {
  placed(add_read<double>(
      command_, name, [&value](double given) { value = given; }, range, help, read_number));
}

void Declaration::take_integer(const std::string& name, const std::function<void(long long)>& take,
                               const NumberRange& range, const std::string& help) const {
  placed(add_read<long long>(command_, name, take, range, help, read_integer));
}

void Declaration::excludes(const std::string& one, const std::string& other) const {
  command_.get_option(one)->excludes(command_.get_option(other));
}

CLI::Option* Declaration::placed(CLI::Option* option) const {
  return group_ == HelpGroup::kOwn ? option : option->group(group_ == HelpGroup::kShared ? kShared : kRare);
}

DeclaredCommand declare(const Subcommand& subcommand) {
  DeclaredCommand declared{std::make_unique<CLI::App>(subcommand.summary, "palpate " + subcommand.name), {}};
  declared.app->set_help_flag();
  declared.run = subcommand.declare(Declaration(*declared.app));
  return declared;
}

std::optional<Error> unknown_option(const CLI::App& command, const std::vector<std::string>& arguments) {
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    const std::string_view argument = arguments[i];
    if (argument == "--") break;
    const std::string_view name = option_name(argument);
    if (name.empty()) continue;
    const CLI::Option* option = command.get_option_no_throw(std::string(name));
    if (option == nullptr) return not_known(command, name);
    // The library takes as many words for values, whatever they look like.
    if (name.size() == argument.size())
      i += static_cast<std::size_t>(
          std::max(0, std::min(option->get_type_size_min(), option->get_items_expected_min())));
  }
  return std::nullopt;
}

std::vector<std::string> option_names(const CLI::App& command) {
  std::vector<std::string> names;
  for (const CLI::Option* option : command.get_options())
    if (!option->get_lnames().empty() && !option->get_group().empty())
      names.push_back("--" + option->get_lnames().front());
  return names;
}

std::string help_text(const Subcommand& subcommand, bool all, const std::vector<Subcommand>& kinds) {
  const DeclaredCommand declared = declare(subcommand);
  const CLI::App& app = *declared.app;
  std::string use, shared = options_text(app, kShared, all), rare = options_text(app, kRare, all);
  for (const CLI::Option* option : app.get_options())
    if (option->get_positional())
      use += option->get_required() ? " " + option->get_name() : " [" + option->get_name() + "]";
  std::string text = joined(wrapped(subcommand.summary, kHelpColumns), "\n") + "\n";
  for (std::size_t i = 0; i < subcommand.examples.size() && (all || i < 2); ++i)
    text += "\n  " + subcommand.examples[i];
  text += fmt::format("\n\npalpate {}{} [OPTION ..]\n{}", subcommand.name, use,
                      options_text(app, "Options", all));
  if (!shared.empty()) text += "common options:\n" + shared;
  if (all && !rare.empty()) text += "rarely needed:\n" + rare;
  if (!all && !rare.empty()) {
    std::string names;
    for (const std::string& name : option_names(app)) {
      if (app.get_option(name)->get_group() == kRare) names += (names.empty() ? "" : ", ") + name;
    }
    text += entry_text("--help-all", "shows " + names);
  }
  if (!kinds.empty()) text += "kinds:\n";
  for (const Subcommand& kind : kinds)
    text += entry_text(kind.name, kind.summary) + "      " + kind.examples.front() + "\n";
  return text;
}

}  // namespace palpate::experiments
