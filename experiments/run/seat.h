// Where a renderer sits while it is measured: in a process of its own, forked from this one, so that no
// renderer inherits what another one left in memory, threads or caches of libraries, and all can stay
// prepared and take turns. Where a process cannot be forked it works in this one.
#pragma once

#include <memory>

#include "experiments/run/work.h"

namespace palpate::experiments {

class Seat {
 public:
  /// `apart`: in a process of its own, where that can be had. What is referred to must outlive the seat.
  Seat(const Stage& stage, const RendererRequest& request, const render::Registry& registry,
       const RunOptions& options, bool apart);
  ~Seat();  ///< ends the process
  Seat(const Seat&) = delete;
  Seat& operator=(const Seat&) = delete;

  /// Does the task there and waits. A process that ends by itself is an Error that says how.
  [[nodiscard]] Result<std::string> ask(Task task, Progress& progress);
  [[nodiscard]] const Answers& answers() const;
  [[nodiscard]] bool is_apart() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Whether another renderer finds room beside those that sit already: a third of the machine's memory is
/// free.
[[nodiscard]] bool has_room();

}  // namespace palpate::experiments
