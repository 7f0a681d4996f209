// A mesh from points by any of the methods: from the cache where it was made before, else made within limits
// and kept.
#pragma once

#include "baselines/reconstruct/mesh_cache.h"
#include "baselines/reconstruct/run_limited.h"

namespace palpate::baselines {

struct ReconstructRequest {
  std::string method;  ///< one of methods()
  Options options;     ///< of it; what is left out has its default
  Limits limits;
  int threads = 0;             ///< 0 = all
  MeshCache* cache = nullptr;  ///< null: neither read nor written
};

/// The reconstruction of `cloud`, model frame. Where it comes from the cache, `recorded` is set and the times
/// are those of the day it was made: to load it again takes a fraction of them. Errors: an unknown method or
/// option, and those of run_limited(); that a limit was reached is remembered too, for requests that allow no
/// more.
[[nodiscard]] Result<Reconstruction> reconstruct(const ReconstructRequest& request, const cloud::Cloud& cloud,
                                                 Progress& progress);

}  // namespace palpate::baselines
