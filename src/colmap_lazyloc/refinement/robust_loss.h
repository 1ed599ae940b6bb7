#pragma once

#include <cmath>

namespace lazyloc {

// The robust loss of bundle adjustment: Cauchy's s^2/2 log(1 + e^2/s^2) of an error e in standard deviations. Another
// loss replaces these functions; nothing else knows which loss it is.
class RobustLoss {
 public:
  explicit RobustLoss(double scale_sigma) : squared_scale_(scale_sigma * scale_sigma) {}

  // Returns the weight of a squared error in iteratively reweighted least squares.
  double Weight(double squared_error) const { return 1 / Factor(squared_error); }

  // Adds up losses. A sum of logarithms is the logarithm of a product, so that a track needs only one.
  class Sum {
   public:
    explicit Sum(const RobustLoss& loss) : loss_(loss) {}

    // Adds the loss of a squared error and returns its weight.
    double Add(double squared_error) {
      const double factor = loss_.Factor(squared_error);
      product_ *= factor;
      if (product_ > kMaxProduct) {
        log_ += std::log(product_);
        product_ = 1;
      }
      return 1 / factor;
    }
    double Value() const { return 0.5 * loss_.squared_scale_ * (log_ + std::log(product_)); }

   private:
    static constexpr double kMaxProduct = 1e250;  // that of 441 errors of 4 standard deviations would overflow

    const RobustLoss& loss_;
    double product_ = 1;
    double log_ = 0;  // of the factors that are not in the product
  };

 private:
  double Factor(double squared_error) const { return 1 + squared_error / squared_scale_; }

  double squared_scale_;
};

}  // namespace lazyloc
