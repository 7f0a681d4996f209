#include <palpate/progress.h>

#include <map>
#include <utility>

namespace palpate {
namespace {

class Silent final : public Progress {
 public:
  void report(std::string_view, double) override {}
};

struct List {
  std::recursive_mutex mutex;
  std::map<std::uint64_t, StopCallback::Action> actions;  ///< by age
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

Progress& no_progress() noexcept {
  static Silent silent;
  return silent;
}

StopCallback::StopCallback(Action action) {
  List& all = list();
  const std::lock_guard lock(all.mutex);
  id_ = ++all.last;
  all.actions.emplace(id_, std::move(action));
}

StopCallback::StopCallback(StopCallback&& other) noexcept : id_(std::exchange(other.id_, 0)) {}

StopCallback& StopCallback::operator=(StopCallback&& other) noexcept {
  if (this != &other) {
    drop();
    id_ = std::exchange(other.id_, 0);
  }
  return *this;
}

void StopCallback::drop() noexcept {
  if (id_ == 0) return;
  List& all = list();
  const std::lock_guard lock(all.mutex);
  all.actions.erase(std::exchange(id_, 0));
}

std::unique_lock<std::recursive_mutex> block_stop() {
  return std::unique_lock(list().mutex);
}

void forget_stop_callbacks() {
  made() = new List;  // the old lock's thread does not exist here
}

std::string run_stop_callbacks() {
  List& all = list();
  all.mutex.lock();  // never unlocked
  std::string said;
  for (auto action = all.actions.rbegin(); action != all.actions.rend(); ++action) {
    const std::string sentence = action->second();
    if (!sentence.empty()) said += (said.empty() ? "" : "; ") + sentence;
  }
  return said;
}

}  // namespace palpate
