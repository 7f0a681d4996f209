// A forked copy of this process that does tasks: what it leaves in memory, threads and caches ends with it,
// and its crash or hang is an Error here.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include <palpate/progress.h>
#include <palpate/result.h>

namespace palpate::experiments {

struct ChildLimits {
  double task_s = 0.0;      ///< processor time of one task; 0: none
  std::uint64_t bytes = 0;  ///< private memory; 0: none
};

class Child {
 public:
  using Work = std::function<Result<std::string>(std::uint64_t task, Progress& progress)>;

  /// `apart`: in a process of its own, where one can be forked; else the tasks are done in this one. Objects
  /// that `work` refers to must outlive the child.
  Child(Work work, bool apart, const ChildLimits& limits = {});
  ~Child();  ///< ends the process and what it started; so does a stop of this program
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  /// Does the task there and waits. Error: the work's; a process that ends by itself or reaches a limit,
  /// which is then gone (`alive()`).
  [[nodiscard]] Result<std::string> ask(std::uint64_t task, Progress& progress);
  [[nodiscard]] bool is_apart() const;
  /// False once its process is gone.
  [[nodiscard]] bool alive() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace palpate::experiments
