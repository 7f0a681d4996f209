// A subcommand: what it is called, what it takes, what it does. The library of the command line stands behind
// this, in cli.cpp alone.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <palpate/options.h>
#include "experiments/session/session.h"

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace palpate::experiments {

/// Where --help shows an option: first, in the group at the end that many commands have, or in --help-all
/// alone.
enum class HelpGroup { kOwn, kShared, kRare };

/// Options of one subcommand, put where their values go. Arguments that are not given stay as they are.
class Declaration {
 public:
  explicit Declaration(CLI::App& command, HelpGroup group = HelpGroup::kOwn)
      : command_(command), group_(group) {}
  /// The same command, for options of that group.
  [[nodiscard]] Declaration shared() const { return Declaration(command_, HelpGroup::kShared); }
  [[nodiscard]] Declaration rare() const { return Declaration(command_, HelpGroup::kRare); }

  /// A word without a name before it ("SCENE"), or an option ("--out"), of any text.
  void text(const std::string& name, std::string& value, const std::string& help) const;
  /// The same where the command does nothing without it.
  void required(const std::string& name, std::string& value, const std::string& help) const;
  /// Words without a name before them, one at least.
  void several(const std::string& name, std::vector<std::string>& values, const std::string& help) const;
  /// An option that may be given several times, one value each.
  void repeated(const std::string& name, std::vector<std::string>& values, const std::string& help) const;
  void choice(const std::string& name, std::string& value, const std::vector<std::string>& choices,
              const std::string& help) const;
  void flag(const std::string& name, bool& value, const std::string& help) const;
  /// --verbose, which is put into the Context.
  void verbose() const;
  /// --emit, --engine and --case, which are put into the Context: of what measures cases by a Suite.
  void cases() const;
  /// A finite number in `range`, which --help-all shows too.
  void number(const std::string& name, double& value, const NumberRange& range,
              const std::string& help) const;
  /// The same for whole numbers; T must hold all of `range`.
  template <class T>
  void integer(const std::string& name, T& value, const NumberRange& range, const std::string& help) const {
    take_integer(
        name, [&value](long long given) { value = static_cast<T>(given); }, range, help);
  }
  /// Not both.
  void excludes(const std::string& one, const std::string& other) const;

 private:
  void take_integer(const std::string& name, const std::function<void(long long)>& take,
                    const NumberRange& range, const std::string& help) const;
  CLI::Option* placed(CLI::Option* option) const;

  CLI::App& command_;
  HelpGroup group_;
};

/// The work of a subcommand with the arguments that were read. The exit status.
using RunSubcommand = std::function<int(Context& context)>;

struct Subcommand {
  std::string name;  ///< "compare", or a kind of it: "compare sweep"
  std::string summary;
  std::vector<std::string> examples;  ///< --help shows two, --help-all every one
  std::function<RunSubcommand(const Declaration&)> declare;
};

/// One whose arguments are an A, which lives as long as what is returned of declare().
/// `run`: an exit status or an Error (exit_status).
template <class A, class Run>
[[nodiscard]] Subcommand subcommand(std::string name, std::string summary, std::vector<std::string> examples,
                                    void (*declare)(const Declaration&, A&), Run run) {
  return {std::move(name), std::move(summary), std::move(examples),
          [declare, run](const Declaration& declaration) -> RunSubcommand {
            auto arguments = std::make_shared<A>();
            declare(declaration, *arguments);
            return [arguments, run](Context& context) {
              return exit_status(Result<int>(run(*arguments, context)), context);
            };
          }};
}

}  // namespace palpate::experiments
