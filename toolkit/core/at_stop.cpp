#include "toolkit/core/at_stop.h"

#include <map>
#include <utility>

namespace palpate {
namespace {

struct List {
  std::recursive_mutex mutex;
  std::map<std::uint64_t, AtStop::Action> actions;  ///< by age
  std::uint64_t last = 0;
};

/// Never destroyed: a static object may drop its action after main().
List*& made() {
  static List* list = new List;
  return list;
}
List& list() {
  return *made();
}

}  // namespace

AtStop::AtStop(Action action) {
  List& all = list();
  const std::lock_guard lock(all.mutex);
  id_ = ++all.last;
  all.actions.emplace(id_, std::move(action));
}

AtStop::AtStop(AtStop&& other) noexcept : id_(std::exchange(other.id_, 0)) {}

AtStop& AtStop::operator=(AtStop&& other) noexcept {
  if (this != &other) {
    drop();
    id_ = std::exchange(other.id_, 0);
  }
  return *this;
}

void AtStop::drop() noexcept {
  if (id_ == 0) return;
  List& all = list();
  const std::lock_guard lock(all.mutex);
  all.actions.erase(std::exchange(id_, 0));
}

std::unique_lock<std::recursive_mutex> hold_stop() {
  return std::unique_lock(list().mutex);
}

void forget_stop_actions() {
  made() = new List;  // the old one's lock belongs to a thread that is not here
}

std::string run_stop_actions() {
  List& all = list();
  all.mutex.lock();  // for ever
  std::string said;
  for (auto action = all.actions.rbegin(); action != all.actions.rend(); ++action) {
    const std::string sentence = action->second();
    if (!sentence.empty()) said += (said.empty() ? "" : "; ") + sentence;
  }
  return said;
}

}  // namespace palpate
