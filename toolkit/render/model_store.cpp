#include <palpate/model_store.h>

#include <fmt/format.h>

#include <algorithm>

namespace palpate::render {

namespace {

/// Findings for the user, whoever prepared the data.
void add_to_report(const PrepareReport& of, PrepareReport& to) {
  to.bytes += of.bytes;
  to.notes.insert(to.notes.end(), of.notes.begin(), of.notes.end());
  to.warnings.insert(to.warnings.end(), of.warnings.begin(), of.warnings.end());
}

}  // namespace

std::shared_ptr<const void> ModelStore::find(const std::string& key, PrepareReport& report) {
  std::erase_if(held_, [](const auto& entry) { return entry.second.geometry.expired(); });
  const auto found = held_.find(key);
  std::shared_ptr<const void> geometry = found == held_.end() ? nullptr : found->second.geometry.lock();
  if (geometry == nullptr) return nullptr;
  add_to_report(found->second.report, report);
  report.shared_bytes += found->second.report.bytes;
  return geometry;
}

void ModelStore::keep(const std::string& key, const std::shared_ptr<const void>& geometry, PrepareReport own,
                      PrepareReport& report) {
  add_to_report(own, report);
  report.total_ms += own.total_ms;
  report.phases.insert(report.phases.end(), own.phases.begin(), own.phases.end());
  held_[key] = {geometry, std::move(own)};
}

std::size_t ModelStore::size() const {
  const std::scoped_lock lock(mutex_);
  return static_cast<std::size_t>(std::count_if(
      held_.begin(), held_.end(), [](const auto& entry) { return !entry.second.geometry.expired(); }));
}

std::string key_text(const Options& options, std::span<const OptionSpec> specs) {
  std::string text;
  for (const OptionSpec& spec : specs) text += fmt::format(" {}={}", spec.key, options.text(spec.key));
  return text;
}

}  // namespace palpate::render
