// A store that shares prepared, immutable data between renderers: points with neighbours and partition,
// meshes with index, height fields. Poses, surfaces and contacts stay with each renderer.
//
// Renderers prepared with one store share equal data, and so do models of one scene with the same cloud.
// Without a store each renderer builds its own, which is what timings use.
//
// First:
//   palpate::render::ModelStore store;  // points, neighbours, meshes: once for all renderers
//   for (const char* name : {"cloud", "cloud-literal"}) {
//     auto renderer = registry.make(name, {});
//     auto report = (*renderer)->prepare(scene, {.store = &store});
//   }
#pragma once

#include <cstddef>
#include <map>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <utility>

#include <palpate/renderer.h>
#include <palpate/result.h>

namespace palpate::render {

/// Thread-safe; preparations run one at a time. Data is freed when no renderer holds it.
class ModelStore {
 public:
  /// Returns the data stored under `key`, or makes it with `make(PrepareReport&) -> Result<shared_ptr<const
  /// Geometry>>`. `key` names everything that the result depends on: kind, content, every option. `report`
  /// receives notes, warnings and bytes in both cases; reused data also counts in report.shared_bytes and
  /// repeats no phases.
  template <class Geometry, class Make>
  [[nodiscard]] Result<std::shared_ptr<const Geometry>> hold(const std::string& key, PrepareReport& report,
                                                             Make&& make) {
    const std::scoped_lock one_at_a_time(mutex_);
    if (std::shared_ptr<const void> held = find(key, report))
      return std::static_pointer_cast<const Geometry>(std::move(held));
    PrepareReport own;
    Result<std::shared_ptr<const Geometry>> made = make(own);
    if (made.ok()) keep(key, *made, std::move(own), report);
    return made;
  }

  /// Number of data sets that renderers hold now.
  [[nodiscard]] std::size_t size() const;

 private:
  struct Entry {
    std::weak_ptr<const void> geometry;
    PrepareReport report;
  };
  [[nodiscard]] std::shared_ptr<const void> find(const std::string& key, PrepareReport& report);
  void keep(const std::string& key, const std::shared_ptr<const void>& geometry, PrepareReport own,
            PrepareReport& report);

  mutable std::mutex mutex_;
  std::map<std::string, Entry> held_;
};

/// Takes the data from the context's store, or makes it for this renderer alone. Calls `key()` only with a
/// store.
template <class Geometry, class Key, class Make>
[[nodiscard]] Result<std::shared_ptr<const Geometry>> get_or_build(const PrepareContext& context,
                                                                   PrepareReport& report, Key&& key,
                                                                   Make&& make) {
  if (context.store == nullptr) return make(report);
  return context.store->hold<Geometry>(key(), report, std::forward<Make>(make));
}

/// A renderer's options as part of a key: " name=value name=value ..".
[[nodiscard]] std::string key_text(const Options& options, std::span<const OptionSpec> specs);

}  // namespace palpate::render
