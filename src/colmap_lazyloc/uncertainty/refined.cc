#include "colmap_lazyloc/uncertainty/refined.h"

#include "colmap_lazyloc/noise/database_priors.h"

namespace lazyloc {

void Refined::SetMissingVariances() {
  missing_variances.clear();
  ForEachMissingVariance(adjustment, variance_factor, [&](size_t group, size_t component, double variance) {
    missing_variances.push_back({group, component, variance});
  });
}

}  // namespace lazyloc
