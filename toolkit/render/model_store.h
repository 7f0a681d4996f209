// What renderers have prepared and never change (points with neighbours and partition, meshes with their
// index, height fields), held once however many renderers use it. Poses, surfaces and contacts are each
// renderer's own.
//
// Two renderers of a scene prepared with one store share what is equal; so do two models of one scene that
// show the same cloud. Without a store every renderer builds its own: what is timed is always built.
#pragma once

#include <cstddef>
#include <map>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <utility>

#include "toolkit/core/result.h"
#include "toolkit/render/renderer.h"

namespace palpate::render {

/// Any number of threads may prepare with one store; one at a time does. What no renderer holds any more is
/// freed.
class ModelStore {
 public:
  /// What is held under the key, or what `make(PrepareReport&) -> Result<shared_ptr<const Geometry>>` makes.
  /// `key` names everything that the result depends on: the kind of geometry, the content that it is made of,
  /// every option. Notes, warnings and bytes go to `report` either way; of what was held already the bytes
  /// are in report.shared_bytes as well, and of its phases none is repeated.
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

  /// Geometries that some renderer holds now.
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

/// From the store of the context where it has one, else made for this renderer alone. `key()` is asked only
/// for a store.
template <class Geometry, class Key, class Make>
[[nodiscard]] Result<std::shared_ptr<const Geometry>> held_or_made(const PrepareContext& context,
                                                                   PrepareReport& report, Key&& key,
                                                                   Make&& make) {
  if (context.store == nullptr) return make(report);
  return context.store->hold<Geometry>(key(), report, std::forward<Make>(make));
}

/// " name=value name=value ..": those of a renderer's options as part of a key.
[[nodiscard]] std::string key_text(const Options& options, std::span<const OptionSpec> specs);

}  // namespace palpate::render
