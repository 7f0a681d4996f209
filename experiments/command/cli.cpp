#include "experiments/command/cli.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <string_view>
#include <vector>

#include "toolkit/core/words.h"

namespace palpate::experiments {
namespace {

template <class T>
void add_read(CLI::App& command, const std::string& name, const std::function<void(T)>& take,
              const NumberRange& range, const std::string& help,
              Result<T> (*read)(std::string_view, const NumberRange&), const std::string& kind) {
  CLI::Option* option = command.add_option_function<std::string>(
      name,
      [take, range, name, read](const std::string& text) {
        const Result<T> number = read(text, range);
        if (!number) throw CLI::ValidationError(name, number.error().what);
        take(*number);
      },
      help);
  const std::string where = text_of(range);
  option->type_name(where.empty() ? kind : kind + " " + where);
}

/// The letter or the word behind the dashes, without a value; empty where the argument is no option.
std::string_view option_name(std::string_view argument) {
  const bool dashed = argument.size() > 1 && argument[0] == '-';
  // A minus before a digit or a point is a number's.
  const bool number = dashed && (argument[1] == '.' || (argument[1] >= '0' && argument[1] <= '9'));
  return dashed && !number ? argument.substr(0, argument.find('=')) : std::string_view();
}

Error not_known(const CLI::App& command, std::string_view name) {
  std::vector<std::string> known;
  for (const CLI::Option* option : command.get_options())
    for (const std::string& word : option->get_lnames()) known.push_back(word);
  const std::string_view word = name.substr(std::min(name.size(), name.find_first_not_of('-')));
  const std::string near = nearest_name(word, known);
  return Error{
      "unknown option " + shown(name), near.empty() ? std::string() : "did you mean --" + near + "?", {}, 0};
}

/// An empty text is what a script's unset variable leaves: it is no choice of the default.
std::string given_and_empty(const std::string& text) {
  return text.empty() ? "is empty; leave it out for the default, or give it a value" : "";
}

}  // namespace

void Declaration::text(const std::string& name, std::string& value, const std::string& help) const {
  command_.add_option(name, value, help)->check(given_and_empty);
}

void Declaration::required(const std::string& name, std::string& value, const std::string& help) const {
  command_.add_option(name, value, help)->required()->check(given_and_empty);
}

void Declaration::several(const std::string& name, std::vector<std::string>& values,
                          const std::string& help) const {
  command_.add_option(name, values, help)->required()->check(given_and_empty);
}

void Declaration::repeated(const std::string& name, std::vector<std::string>& values,
                           const std::string& help) const {
  command_.add_option(name, values, help)->allow_extra_args(false)->check(given_and_empty);
}

void Declaration::choice(const std::string& name, std::string& value, const std::vector<std::string>& choices,
                         const std::string& help) const {
  command_.add_option(name, value, help)->check(CLI::IsMember(choices));
}

void Declaration::flag(const std::string& name, bool& value, const std::string& help) const {
  command_.add_flag(name, value, help);
}

void Declaration::number(const std::string& name, double& value, const NumberRange& range,
                         const std::string& help) const {
  add_read<double>(
      command_, name, [&value](double given) { value = given; }, range, help, read_number, "NUMBER");
}

void Declaration::take_integer(const std::string& name, const std::function<void(long long)>& take,
                               const NumberRange& range, const std::string& help) const {
  add_read<long long>(command_, name, take, range, help, read_integer, "INTEGER");
}

void Declaration::excludes(const std::string& one, const std::string& other) const {
  command_.get_option(one)->excludes(command_.get_option(other));
}

void declare(CLI::App& app, const std::vector<Subcommand>& subcommands, Runs& runs) {
  for (const Subcommand& subcommand : subcommands) {
    CLI::App* command = app.add_subcommand(subcommand.name, subcommand.summary);
    runs[subcommand.name] = subcommand.declare(Declaration(*command));
    std::string footer = "Examples:";
    for (const std::string& example : subcommand.examples) footer += "\n  " + example;
    command->footer(footer);
  }
}

std::optional<Error> unknown_option(const CLI::App& app, int argc, const char* const* argv) {
  const CLI::App* command = &app;
  for (int i = 1; i < argc; ++i) {
    const std::string_view argument = argv[i];
    if (argument == "--") break;
    const std::string_view name = option_name(argument);
    if (name.empty()) {
      const auto inner = app.get_subcommands([&](const CLI::App* a) { return a->get_name() == argument; });
      if (command == &app && !inner.empty()) command = inner.front();
      continue;
    }
    const CLI::Option* option = command->get_option_no_throw(std::string(name));
    if (option == nullptr) return not_known(*command, name);
    // The library takes as many words for values, whatever they look like.
    if (name.size() == argument.size())
      i += std::min(option->get_type_size_min(), option->get_items_expected_min());
  }
  return std::nullopt;
}

}  // namespace palpate::experiments
