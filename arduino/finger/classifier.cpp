#include "classifier.h"

Classifier::Classifier(const ClassifierModel &model) : model_(model)
{
    for (uint16_t i = 0; i < FEATURES; i++) mean_[i] = model.mean[i];
    start();
}

void Classifier::start()
{
    for (double &feature : features_) feature = 0.0;
}

void Classifier::add(const WindowReport &window)
{
    if (window.window >= WINDOWS) return;
    for (uint8_t i = 0; i < TAXELS; i++)
        features_[i * WINDOWS + window.window] = window.spikes[i] * 1000.0 / window.real_ms;
}

void Classifier::set_mean(uint8_t window, const double (&mean)[TAXELS])
{
    for (uint8_t i = 0; i < TAXELS; i++) mean_[i * WINDOWS + window] = mean[i];
}

Prediction Classifier::predict(uint32_t scan) const
{
    double scores[MAX_COMPONENTS] = {};
    for (uint16_t i = 0; i < FEATURES; i++) {
        const double *axes = model_.axes + i * model_.components;
        for (uint8_t k = 0; k < model_.components; k++)
            scores[k] += (features_[i] - mean_[i]) * axes[k];
    }
    Prediction prediction = {scan, 0, model_.classes, {}};
    for (uint8_t c = 0; c < model_.classes; c++) {
        double sum = model_.intercepts[c];
        for (uint8_t k = 0; k < model_.components; k++)
            sum += model_.coefficients[c * model_.components + k] * scores[k];
        prediction.discriminants[c] = sum;
        if (sum > prediction.discriminants[prediction.best]) prediction.best = c;
    }
    return prediction;
}
