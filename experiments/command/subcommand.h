// A subcommand: what it is called, what it takes, what it does. The library of the command line stands behind
// this, in cli.cpp alone.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "experiments/session/session.h"
#include "toolkit/core/options.h"

namespace CLI {
class App;
}

namespace palpate::experiments {

/// Options of one subcommand, put where their values go. What is not given stays as it is.
class Declaration {
 public:
  explicit Declaration(CLI::App& command) : command_(command) {}

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
  /// A finite number in `range`, which --help shows too.
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

  CLI::App& command_;
};

/// What a subcommand does with the arguments that were read. The exit status.
using RunSubcommand = std::function<int(Context& context)>;

struct Subcommand {
  std::string name, summary;
  std::vector<std::string> examples;
  std::function<RunSubcommand(const Declaration&)> declare;
};

/// One whose arguments are an A, which lives as long as what is returned of declare().
template <class A>
[[nodiscard]] Subcommand subcommand(std::string name, std::string summary, std::vector<std::string> examples,
                                    void (*declare)(const Declaration&, A&), int (*run)(const A&, Context&)) {
  return {std::move(name), std::move(summary), std::move(examples),
          [declare, run](const Declaration& declaration) -> RunSubcommand {
            auto arguments = std::make_shared<A>();
            declare(declaration, *arguments);
            return [arguments, run](Context& context) { return run(*arguments, context); };
          }};
}

}  // namespace palpate::experiments
