// The folder of a run's results: locked while the run lasts, with a list of the files that are ours, and with
// what is complete of the run, so that the next one can go on from there.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "toolkit/core/result.h"

namespace palpate::experiments {

/// Marks a folder as Palpate's, and is what is locked. It holds the process, the key of a run that is not
/// complete, and the names of our files: only these are ever replaced or removed.
inline constexpr const char* kFolderMark = ".palpate-output";

/// A handle; its copies and those of inside() mean one and the same folder. The last one gives the lock back;
/// where no part of the run is complete it takes away what was made. Not thread-safe.
class OutputFolder {
 public:
  /// Makes the folder where it is missing, with its parents, and locks it; nothing in it changes before
  /// begin(). Errors: another process has it (named); it holds something and no mark of an earlier run, so
  /// that its files are somebody else's; it cannot be made, written or locked.
  [[nodiscard]] static Result<OutputFolder> open(const std::string& folder);

  /// Opens a folder that a run has completed, or one inside such a folder, to put files into it or to replace
  /// them; all others stay. Errors: there is none, or Palpate did not write it; another process has it.
  [[nodiscard]] static Result<OutputFolder> reopen(const std::string& folder);

  /// An Error where one of `files`, which the run reads, is a file of ours here: it would be replaced.
  [[nodiscard]] Status check_not_read(std::span<const std::string> files) const;

  /// Begins a run of this key (what its results depend on; one line). Our files of earlier runs are removed;
  /// only those of a run of the same key that is not complete stay, so that take_over() finds its parts.
  enum class Begun {
    kAnew,
    kGoesOn,
    kOtherDropped
  };  ///< the last: a run that was not complete had another key
  [[nodiscard]] Result<Begun> begin(const std::string& key) const;

  /// Files claimed from here on, and not before, belong to the next part that is kept.
  void start_part() const;
  /// A part of the run is complete, with its files and with `text` to make the rest from again. `part` is a
  /// file name, and shown to the user.
  [[nodiscard]] Status keep(const std::string& part, const std::string& key, const std::string& text) const;
  /// Takes over a part that an interrupted run has kept under this key, if all its files are as they were and
  /// `use` makes what it needs from its text. Its files are then files of this run.
  [[nodiscard]] bool take_over(const std::string& part, const std::string& key,
                               const std::function<bool(const std::string& text)>& use) const;

  /// The run is complete: its parts, and what earlier runs left, are removed.
  [[nodiscard]] Status complete() const;

  /// Where a file is, for reading and showing.
  [[nodiscard]] std::filesystem::path file(const std::string& name) const { return path() / name; }
  [[nodiscard]] std::filesystem::path path() const;
  /// Where a file is, to be written by the caller: from here on it is ours. An Error where somebody else's
  /// file has the name.
  [[nodiscard]] Result<std::string> claim(const std::string& name) const;
  /// A claimed file, whole or not at all.
  [[nodiscard]] Status write(const std::string& name, std::string_view text) const;
  /// A folder inside, made where missing.
  [[nodiscard]] Result<OutputFolder> inside(const std::string& name) const;

 private:
  struct State;
  OutputFolder(std::shared_ptr<State> state, std::string below)
      : state_(std::move(state)), below_(std::move(below)) {}
  std::shared_ptr<State> state_;
  std::string below_;  ///< "figures/"; empty for the folder itself
};

}  // namespace palpate::experiments
