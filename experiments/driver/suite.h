// A command that takes long: checks its arguments, does its cases one after the other, each once whatever
// interrupts it, and writes a document and a page. Cases are kept as parts (once), or in a file that grows
// case by case and is a result itself (the record of begin).
//
//   Suite suite(context);
//   PALPATE_TRY(suite.open(arguments.out));
//   PALPATE_TRY(suite.begin(RunKey().add(arguments.path)));
//   PALPATE_ASSIGN(const Row row, suite.once<Row>("cloud", key, [&] { return measure(); }));
//   if (suite.partial()) return suite.leave();
//   PALPATE_TRY(suite.publish({"rows.json", to_json(row), {table_of(row)}}, page, arguments.json));
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "experiments/report/page.h"
#include "experiments/session/session.h"

namespace palpate::experiments {

/// Results that a suite leaves and prints.
struct SuiteResults {
  std::string file;                     ///< of the document
  std::string json;                     ///< its text
  std::vector<Table> tables;            ///< printed, where the document is not
  std::vector<std::string> warnings{};  ///< told on standard error
  std::vector<std::string> faults{};    ///< the same, before the warnings
};

class Suite {
 public:
  explicit Suite(Context& context) : context_(context) {}

  /// Opens the result folder (OutputFolder::open). Error too: it is one of the files `read`.
  [[nodiscard]] Status open(const std::string& out, std::span<const std::string> read = {});
  /// Begins, or goes on from an earlier run (OutputFolder::begin), and says so where that was interrupted.
  /// From here on an Error is a run that fell short, before it one of bad input (Context::working).
  [[nodiscard]] Status begin(const RunKey& key, const std::string& record = {});

  [[nodiscard]] Context& context() const { return context_; }
  [[nodiscard]] ProgressBar& progress() const { return context_.progress; }
  [[nodiscard]] const OutputFolder& folder() const { return *folder_; }

  /// The value that an interrupted run has kept of a case; false: there is none. A T is described
  /// for JSON where this is called (json_members.h).
  template <class T>
  [[nodiscard]] bool take(const std::string& name, const std::string& key, T& value) const {
    return folder_->take_over(name, key, [&](const std::string& text) { return from_line(text, value); });
  }
  /// Keeps a case, with the files claimed since the last one.
  template <class T>
  [[nodiscard]] Status keep(const std::string& name, const std::string& key, const T& value) const {
    PALPATE_TRY(folder_->keep(name, key, to_line(value)));
    folder_->start_part();
    return Done{};
  }
  /// A case's value: kept by an interrupted run, or measured now and kept. `name`: a file name, shown to the
  /// user. `measure`: a Result<T>. Empty where another process measures the case; see partial().
  template <class T, class Measure>
  [[nodiscard]] Result<T> once(const std::string& name, const std::string& key, const Measure& measure,
                               Case about = {}) const {
    T value{};
    if (take(name, key, value)) return value;
    about.name = name;
    if (!measures(about)) return value;
    folder_->start_part();
    PALPATE_ASSIGN(value, measure());
    PALPATE_TRY(keep(name, key, value));
    return value;
  }

  /// Whether a case that was not taken is measured here: always, unless other processes measure it.
  [[nodiscard]] bool measures(const Case& one) const;
  /// Whether this process leaves cases to others (CaseSelection). Behind its last case it ends by leave().
  [[nodiscard]] bool partial() const { return !context_.cases.all(); }
  /// Writes the list of cases, or leaves what was measured where the whole command finds it. The exit status.
  [[nodiscard]] Result<int> leave() const;
  /// Files of this name that processes of one case left in this folder, sorted.
  [[nodiscard]] std::vector<std::string> files_of_cases(const std::string& name) const;

  /// Writes document and page, and completes the folder.
  [[nodiscard]] Status write(const SuiteResults& results, const Page& page) const;
  /// Writes, and prints: the document with `json`, else what a screen of fifteen lines holds of tables and
  /// warnings (Context::verbose: all of them), and where the page is.
  [[nodiscard]] Status publish(const SuiteResults& results, const Page& page, bool json) const;

 private:
  Context& context_;
  std::optional<OutputFolder> folder_;
};

}  // namespace palpate::experiments
