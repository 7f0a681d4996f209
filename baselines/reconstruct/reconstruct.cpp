#include "baselines/reconstruct/reconstruct.h"

#include <fmt/format.h>

#include "toolkit/core/parallel.h"

namespace palpate::baselines {

Result<Reconstruction> reconstruct(const ReconstructRequest& request, const cloud::Cloud& cloud,
                                   Progress& progress) {
  const Result<const Method*> method = find_method(request.method);
  if (!method) return method.error();
  const Result<Options> options = validate(request.options, (*method)->options, request.method);
  if (!options) return options.error();
  std::string key;
  if (request.cache != nullptr) {
    progress.report(request.method + ": looking into the cache", -1.0);
    key = cache_key(**method, cloud, *options);
    if (std::optional<CachedAnswer> kept = request.cache->find(key, request.limits)) return *std::move(kept);
  }
  const int threads = request.threads > 0 ? request.threads : available_threads();
  Result<Reconstruction> made = run_limited(**method, cloud, *options, request.limits, threads, progress);
  if (request.cache != nullptr)
    if (const Status kept = request.cache->keep(key, made, request.limits); !kept && made)
      made->made.notes.push_back("not kept in the cache: " + kept.error().message());
  return made;
}

}  // namespace palpate::baselines
