// PCA and LDA on the board, built with -DFINGER_MODEL='"model.h"' (rigctl realtime train writes it).
//
// Without that flag the board sends features only, and the host classifies them.
#ifndef FINGER_CLASSIFIER_H
#define FINGER_CLASSIFIER_H

#include <stdint.h>

#include "scan.h"

const uint8_t WINDOWS = 20;
const uint16_t FEATURES = uint16_t(TAXELS) * WINDOWS;

// A trained model. Features are taxel after taxel, each with its 20 windows, in spikes/s.
struct ClassifierModel {
    uint8_t classes, components;
    const double *mean;          // FEATURES
    const double *axes;          // FEATURES × components, row by row
    const double *coefficients;  // classes × components
    const double *intercepts;    // classes
};

const uint8_t MAX_CLASSES = 8, MAX_COMPONENTS = 96;

// What the features of a scan say: the class of the highest discriminant, and all discriminants.
struct Prediction {
    uint32_t scan;
    uint8_t best, classes;
    double discriminants[MAX_CLASSES];
};

// Collects the windows of a scan and classifies them at its end.
class Classifier {
public:
    explicit Classifier(const ClassifierModel &model);

    void start();
    // Windows beyond the last one are dropped; a missing one is 0.
    void add(const WindowReport &window);
    Prediction predict(uint32_t scan) const;

    // Replaces the mean of a window's features: that of this session's calibration.
    void set_mean(uint8_t window, const double (&mean)[TAXELS]);

private:
    const ClassifierModel &model_;
    double mean_[FEATURES], features_[FEATURES];
};

#endif
